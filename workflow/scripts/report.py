"""Write the report."""

from pathlib import Path

from coronaryuq.report.page import write_report
from job import job

with job(globals()) as this:
    files = {name: path for name, path in this.input.items() if name not in ("figures", "code", "template")}
    logs = Path(this.log).parent
    write_report(files, this.input["figures"], logs, this.params["configuration"], this.output["report"])
