"""From files with vessels to FFR: minutes and CPU seconds of `init`, `check` and the smallest campaign, per anatomy.

Each PATH (what `coronaryuq init` takes) becomes a case without a question. What only a user knows is made up: a
hyperaemic flow of the left ventricle, divided by Murray's law; pressures and volumes; a stretch of an artery, as
`check` proposes it, where no narrowing was found; the wire's place that `init` gives as an example. The campaign has
the settings of the configuration smoke. A network has no 3D model, so that its campaign ends with the posterior.
A PATH may carry options of `init`, such as "PROJECT --group LAD_final".

    python benchmarks/anatomies.py WORK PATH...   # one JSON line each; folders in WORK
"""

import csv
import json
import re
import resource
import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from coronaryuq.case.network.build import murray_shares
from coronaryuq.cli.check import Checked, check
from coronaryuq.core import shipped

FLOW = 250.0
"""mL/min: hyperaemic flow of the left ventricle."""
TARGETS = {
    "PaoMin": 70.0,
    "PaoMax": 120.0,
    "PaoMean": 90.0,
    "AbsQin": 75.0,
    "AorCorSplit": 4.0,
    "HR": 70.0,
    "EFLV": 0.6,
}
"""In the units of the table."""
CORES = "2"
QUESTION = re.compile(r"flow: not given|perfuses of|branch of")


def run(folder: Path, *words: str) -> dict[str, Any]:
    """Run a command of coronaryuq; return its exit code, wall and CPU seconds, and its last line."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    command = [sys.executable, "-m", "coronaryuq.cli.main", *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, encoding="utf-8", errors="replace", check=False)
    after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic() - start
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    (folder / f"{words[0]}.log").write_text(done.stdout + done.stderr, encoding="utf-8")
    said = (done.stderr if done.returncode else done.stdout).strip().splitlines()
    return {"code": done.returncode, "wall": round(wall, 1), "cpu": round(cpu, 1), "said": said[-1] if said else ""}


def fill(folder: Path) -> Checked:
    """Fill in what only a user knows; return what `check` then finds."""
    case = folder / "case.yaml"
    outlets = _rows(folder / "outlets.csv")
    for row in outlets:
        row["branch"], row["perfuses"] = row["branch"] or "LAD", row["perfuses"] or "LV"
    _write(folder / "outlets.csv", outlets)
    feeding = [row["name"] for row in outlets if row["perfuses"] == "LV"]
    _write(folder / "flows.csv", [{"name": name, "flow": f"{FLOW / len(feeding)}"} for name in feeding])
    targets = _rows(folder / "targets.csv")
    for row in targets:
        row["value"] = f"{TARGETS[row['name']]:g}" if row["name"] in TARGETS else row["value"]
    _write(folder / "targets.csv", targets)
    found = check(case)
    if found.case is None:
        return found
    radii = {outlet.name: outlet.radius for outlet in found.case.summary.outlets if outlet.name in feeding}
    shares = murray_shares(list(radii.values()))
    _write(folder / "flows.csv", [{"name": n, "flow": f"{FLOW * s:.4g}"} for n, s in zip(radii, shares, strict=True)])
    text = case.read_text(encoding="utf-8").replace("# ffr_at: ", "ffr_at: ")
    example = next((match for line in found.lines if (match := re.search(r"stenoses: (\[.*\])$", line))), None)
    if example:
        text = re.sub(r"^stenoses: \[\]$", f"stenoses: {example[1]}", text, flags=re.MULTILINE)
    case.write_text(text, encoding="utf-8")
    return check(case)


def _rows(path: Path) -> list[dict[str, str]]:
    with open(path, encoding="utf-8", newline="") as opened:
        return list(csv.DictReader(opened))


def _write(path: Path, rows: list[dict[str, str]]) -> None:
    with open(path, "w", encoding="utf-8", newline="") as opened:
        writer = csv.DictWriter(opened, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def measure(work: Path, source: Path, options: Sequence[str] = ()) -> dict[str, Any]:
    """Return the times of one anatomy, up to the first command that fails; options: of `init`."""
    name = re.sub(r"\W+", "-", "-".join(source.resolve().with_suffix("").parts[-2:]))
    folder = work / name
    line: dict[str, Any] = {"anatomy": name}
    line["init"] = run(work, "init", str(source.resolve()), *options, "--into", name, "--yes")
    if not (folder / "case.yaml").exists():
        return line
    found = fill(folder)
    settings = yaml.safe_load(shipped.configuration("smoke").read_text(encoding="utf-8"))
    (folder / "campaign.yaml").write_text(yaml.safe_dump(settings | {"name": name, "case": "case.yaml"}))
    line["check"] = run(folder, "check", "case.yaml")
    if found.case is None:
        return line
    summary = found.case.summary
    line |= {"outlets": len(summary.outlets), "stenoses": [s.name for s in summary.stenoses]}
    line["notes"] = [*summary.notes]
    target = [] if summary.stenoses and found.case.description.anatomy else ["posterior"]
    line["run"] = run(folder, "run", "campaign.yaml", *target, "--cores", CORES)
    line["minutes"] = round(sum(line[key]["wall"] for key in ("init", "check", "run")) / 60, 2)
    line["ffr"] = _ffr(folder / "results" / name)
    return line


def _ffr(results: Path) -> dict[str, float]:
    """Return the mean of each FFR over the 3D runs."""
    path = results / "estimation" / "table.csv"
    if not path.exists():
        return {}
    found = [row for row in _rows(path) if row["column_3d"].startswith("ffr_") and row["estimator"] == "MC"]
    return {row["column_3d"]: round(float(row["mean"]), 4) for row in found}


def main(work: str, *paths: str) -> None:
    """Measure the anatomies one after another."""
    folder = Path(work).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for words in paths:
        path, *options = shlex.split(words)
        print(json.dumps(measure(folder, Path(path), options)), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
