"""README.md and index.json of a results folder: every file, the job that wrote it, columns and units."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from coronaryuq import config
from coronaryuq.campaign import explain
from coronaryuq.campaign.files import FOLDERS, described, kind_of
from coronaryuq.core.io.atomic import read_json, write_json, write_text
from coronaryuq.core.io.tables import read_table_text
from coronaryuq.core.io.text import visible

README, INDEX = "README.md", "index.json"
APART = ("logs", explain.FOLDER, "costs")
"""Folders whose files the index does not list one by one."""


def describe_results(home: str | Path) -> None:
    """Write both files at the end of a campaign; an error in describing it does not make the campaign fail."""
    if Path(home).is_dir():
        try:
            write_index(home)
        except (OSError, ValueError) as error:  # broken notes and tables raise a ValueError
            print(f"note: no index of {home}: {error}", file=sys.stderr)


def write_index(home: str | Path) -> None:
    """Describe the present files of a results folder; the same results give the same bytes."""
    home = Path(home)
    jobs = _jobs(home)
    files, columns = [], {}
    for path in sorted(_files(home)):
        name = path.relative_to(home).as_posix()
        kind = kind_of(name)
        entry = {"file": name, "what": kind.what if kind else None, "made_by": jobs.get(name)}
        if kind and kind.columns:
            columns[name] = described(kind, _heading(path, name))
        files.append(entry)
    campaign = home / explain.CAMPAIGN
    settings = config.load(campaign) if campaign.is_file() else None
    index = {"format": "coronaryuq-index-1", "campaign": home.name, "files": files, "columns": columns}
    write_json(home / INDEX, index)
    write_text(home / README, _readme(home, settings, files))


def _files(home: Path) -> Iterator[Path]:
    apart = (*APART, "mesh-complete", "chains", "checkpoints")
    for path in home.rglob("*"):
        inside = path.relative_to(home).parts[:-1]
        own = path.parent == home and path.name in (README, INDEX)
        if path.is_file() and not own and not path.name.startswith(".") and not set(inside) & set(apart):
            yield path


def _jobs(home: Path) -> dict[str, str]:
    """Return the job that wrote each result last."""
    newest: dict[str, tuple[str, str]] = {}
    for path in visible(home / explain.FOLDER, "*.json"):
        note = read_json(path, ("results", "made", "job"))
        for result in note["results"]:
            name = Path(*Path(result).parts[2:]).as_posix()
            newest[name] = max(newest.get(name, ("", "")), (note["made"], note["job"]))
    return {name: job for name, (_, job) in newest.items()}


def _heading(path: Path, name: str) -> list[str]:
    """Return the names of a table's columns."""
    if path.suffix == ".parquet":
        import pyarrow.parquet

        return list(pyarrow.parquet.read_schema(path).names)
    if name == "patient/targets.csv":  # svZeroDSolver's format has no header
        return ["name", "description", "value"]
    text, separator = read_table_text(path)
    return next(iter(text.splitlines()), "").split(separator)


def _readme(home: Path, settings: config.Campaign | None, files: list[dict[str, Any]]) -> str:
    lines = [f"# Results of the campaign `{home.name}`", ""]
    if settings is not None:
        case = "the bundled patient" if settings.case == "bundled" else f"the case `{settings.case}`"
        lines += [
            f"Made by coronaryuq for {case}, seed {settings.seed}, with {settings.samples.n_3d} 3D runs "
            f"({settings.backend}) and {settings.samples.n_0d} 0D runs per input set.",
            "The whole configuration is `campaign.yaml`. Research use only; not a medical device.",
            "",
        ]
    lines += [
        "Units are CGS (pressure dyn/cm2, flow mL/s, lengths cm) unless `index.json` gives another "
        "unit. It lists every",
        "file with the job that wrote it, and every column of every table with its meaning and unit.",
        "",
        "| folder | contents | files |",
        "|---|---|---|",
    ]
    for folder, what in FOLDERS.items():
        count = sum(entry["file"].startswith(f"{folder}/") for entry in files)
        if count or (folder in APART and (home / folder).is_dir()):
            lines.append(f"| `{folder}/` | {what} | {count or '–'} |")
    lines += ["", *(f"- `{e['file']}`: {e['what']}" for e in files if "/" not in e["file"] and e["what"]), ""]
    where = f"results/{home.name}"
    lines += [
        f"    coronaryuq explain {where}/FILE    where a file comes from, and the command that reproduces it",
        f"    coronaryuq verify {where}          which files have changed since their jobs wrote them",
        "",
        f'From Python: `import coronaryuq; c = coronaryuq.open("{where}")`.',
        "",
    ]
    return "\n".join(lines)
