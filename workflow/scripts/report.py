"""Write the report."""

from pathlib import Path

from coronaryuq.report.page import write_report
from job import job

with job(globals()) as this:
    others = ("figures", "answers", "drawn", "truths", "code", "templates")
    files = {name: path for name, path in this.input.items() if name not in others}
    if study := this.params["mesh_study"]:
        files["mesh_study"] = study["path"]
    logs = Path(this.log).parent
    searches = this.input["answers"], this.input["drawn"], this.input["truths"]
    write_report(files, this.input["figures"], logs, this.params["configuration"], this.output["report"], searches)
