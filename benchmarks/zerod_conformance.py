"""Add a run of `coronaryuq bench conformance --json` to zerod-conformance.json and the page on the 0D solver.

Argument: a file with that JSON, or none to write the table of the recorded run again.
"""

import json
import sys
from pathlib import Path

FOLDER = Path(__file__).parent
RUN, PAGE = FOLDER / "zerod-conformance.json", FOLDER.parent / "docs" / "explanation" / "zerod.md"
BEGIN, END = "<!-- table of conformance -->\n", "<!-- end of table of conformance -->\n"


def table(run: dict) -> str:
    """Return a row per case, those that fail in both last."""
    lines = ["| case | rows | largest difference | at |", "|---|---|---|---|"]
    for case in sorted(run["cases"], key=lambda case: case["difference"] is None):
        name = case["case"].removesuffix(".json").removeprefix("vmr/")
        if case["difference"] is None:
            lines.append(f"| `{name}` | | | both refuse: {case['refused']} |")
            continue
        own = "" if case["own_change"] is None else f" ({case['own_change']:.1e}: svZeroDSolver from itself, see below)"
        where = f"`{case['where']}`" if case["where"] else ""
        lines.append(f"| `{name}` | {case['rows']} | {case['difference']:.1e}{own} | {where} |")
    return "\n".join(lines) + "\n"


def put(page: str, run: dict) -> str:
    """Return the page with the table of the run."""
    before, rest = page.split(BEGIN)
    return before + BEGIN + table(run) + END + rest.split(END)[1]


if __name__ == "__main__":
    if sys.argv[1:]:
        RUN.write_text(json.dumps(json.loads(Path(sys.argv[1]).read_text()), indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(
        put(PAGE.read_text(encoding="utf-8"), json.loads(RUN.read_text(encoding="utf-8"))), encoding="utf-8"
    )
