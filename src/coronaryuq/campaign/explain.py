"""Provenance notes of jobs, and `coronaryuq explain` and `verify`, which read them.

Every job writes one note, `results/NAME/provenance/JOB.json`: its inputs and outputs, settings, code, libraries and
machine. Notes are kept apart from the results, because results are bitwise identical on every machine and notes are
not. A cache shared between campaigns contains a copy of the note under the checksum of each result.
"""

import json
import os
import platform
import re
import shlex
import shutil
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml

from coronaryuq.core import provenance, shipped
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json, write_text
from coronaryuq.core.io.lock import lock_results
from coronaryuq.core.io.text import visible

FOLDER = "provenance"
CAMPAIGN = "campaign.yaml"
"""File in the results folder with the whole configuration of the last run."""
CONFIGURATIONS = "CORONARYUQ_CAMPAIGNS"
"""Environment variable with the whole configuration of every campaign that a workflow runs, by name (JSON)."""
OF_THE_CAMPAIGN = (CAMPAIGN, ".lock", "README.md", "index.json")
"""Files in the results folder that belong to the campaign, not to one of its jobs."""
UNCHANGED = "unchanged"
CACHE = "SNAKEMAKE_OUTPUT_CACHE"
CACHED = "coronaryuq-provenance"


def write_note(
    job: str,
    inputs: Mapping[str, str | Sequence[str]],
    outputs: Mapping[str, str | Sequence[str]],
    params: Mapping[str, Any],
    resources: Mapping[str, Any],
    snakefile: str | Path,
) -> None:
    """Write the note of a job; for results outside `results/NAME` write none.

    Parameters
    ----------
    job
        Rule and wildcards.
    inputs, outputs
        Paths by name, relative to the working folder.
    params, resources
        Parameters of the rule, with `function` and the digest of its `code`; threads, MPI ranks and cost.
    snakefile
        The Snakefile that contains the rule, or that uses the workflow as a module.
    """
    results = {path: checksum(path) for path in _flat(outputs.values()) if Path(path).exists()}
    campaign = next((folder for folder in map(_campaign_folder, results) if folder), None)
    if campaign is None:
        return
    note = {
        "job": job,
        "results": results,
        "inputs": {path: checksum(path) for path in _flat(inputs.values())},
        "params": {name: _plain(value) for name, value in params.items()},
        **provenance.stamp(libraries=provenance.versions()),
        "machine": {
            "name": platform.node(),
            "system": f"{platform.system()} {platform.release()} {platform.machine()}",
            "cores": os.cpu_count(),
        },
        "resources": dict(resources),
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "folder": Path.cwd().as_posix(),
        "snakefile": os.path.abspath(snakefile),
    }
    _write_configuration(campaign)
    write_json(campaign / FOLDER / f"{re.sub('[ /]', '-', job)}.json", note)
    cache = os.environ.get(CACHE)
    if cache and os.access(cache, os.W_OK):
        for content in results.values():
            write_json(Path(cache, CACHED, f"{content}.json"), note)


def _write_configuration(campaign: Path) -> None:
    """Write the whole configuration of the campaign that runs this job, if it is not there yet."""
    whole = json.loads(os.environ.get(CONFIGURATIONS, "{}")).get(campaign.name)
    path = campaign / CAMPAIGN
    if whole is not None and not (path.is_file() and path.read_text(encoding="utf-8") == whole):
        write_text(path, whole)


def checksum(path: str | Path) -> str:
    """Return the SHA-256 of a file, or of the names and checksums of a folder's files.

    The hidden file that Snakemake adds to a folder after the job is not part of the result.
    """
    path = Path(path)
    if path.is_file():
        return provenance.checksum(path)
    inside = sorted(p for p in path.rglob("*") if p.is_file() and p.name != ".snakemake_timestamp")
    return provenance.digest([[p.relative_to(path).as_posix(), provenance.checksum(p)] for p in inside])


@dataclass(frozen=True)
class Origin:
    """Origin of a result.

    Attributes
    ----------
    name
        Path of the result, relative to the folder that contains `results/`.
    note
        The note of the job that wrote it.
    entry
        The entry of the note's `results` that is the file, or a folder that contains it.
    home
        Results folder of the campaign.
    unchanged
        Whether it is unchanged since its job wrote it.
    """

    name: str
    note: Mapping[str, Any]
    entry: str
    home: Path
    unchanged: bool

    @property
    def path(self) -> Path:
        return self.home.parents[1] / self.name

    @property
    def command(self) -> str:
        """The shell command that reproduces the result, from any folder."""
        return remake(self.note, self.entry, self.home)

    def as_json(self) -> dict[str, Any]:
        """Return the origin as `coronaryuq explain --json` prints it (docs/reference/formats.md)."""
        kept = ("job", "made", "code", "python", "libraries", "machine", "resources", "params")
        inputs = {file: _state(self.home.parents[1] / file, content) for file, content in self.note["inputs"].items()}
        return {
            "result": self.name,
            "unchanged": self.unchanged,
            "from_cache": self.note.get("cached"),
            **{key: self.note[key] for key in kept},
            "solvers": _solvers(self.path),
            "inputs": inputs,
            "results": dict(self.note["results"]),
            "command": self.command,
        }

    def __str__(self) -> str:
        note, state = self.note, "unchanged since its job wrote it"
        if not self.unchanged:
            state = "CHANGED since its job wrote it: regenerate it"
        lines = [f"{self.name}: {state}", "", f"made by     {note['job']}, {note['made']}"]
        if "cached" in note:
            lines.append(f"taken from  the cache; first made as {note['cached']}")
        lines += [
            f"code        {note['code']}{_behind(note['params'])}",
            f"machine     {note['machine']['name']}: {note['machine']['system']}, {note['machine']['cores']} cores",
            f"resources   {', '.join(f'{key} {value}' for key, value in note['resources'].items())}",
            f"python      {note['python']}",
            f"libraries   {', '.join(f'{key} {value}' for key, value in note['libraries'].items())}",
        ]
        lines += [f"solver      {solver}" for solver in _solvers(self.path)]
        lines += ["settings", *_indented(note["params"]), "inputs"]
        for file, content in note["inputs"].items():
            state = _state(self.home.parents[1] / file, content)
            lines.append(f"  {content[:16]}  {file}" + (f"  ({state})" if state != UNCHANGED else ""))
        lines += ["results", *(f"  {content[:16]}  {file}" for file, content in note["results"].items())]
        return "\n".join([*lines, "to reproduce it", f"  {self.command}"])

    __repr__ = __str__


def explain(result: str | Path) -> Origin:
    """Return the origin of a result, and whether it is unchanged since its job wrote it.

    Raises
    ------
    InputError
        If the path does not exist, is not a result of a campaign, or if no job has written it.
    """
    path = Path(os.path.abspath(result))
    if not path.exists():
        raise InputError(result, None, None, "no such file; run the campaign that makes it")
    home = _campaign_folder(path)
    if home is None:
        raise InputError(result, None, None, "not a result: it is in no campaign's folder, results/NAME")
    name = path.relative_to(home.parents[1]).as_posix()
    if path == home or (path.parent == home and path.name in OF_THE_CAMPAIGN):
        raise InputError(result, None, None, "not a result but the campaign itself; name a file that a job wrote")
    if path.parent == home / FOLDER:
        raise InputError(result, None, None, "a note about results; name one of the results")
    note, entry = _note(home, path, name)
    unchanged = checksum(path if entry == name else home.parents[1] / entry) == note["results"][entry]
    return Origin(name, note, entry, home, unchanged)


@dataclass(frozen=True)
class Verified:
    """Results compared with the checksums that their jobs recorded.

    Attributes
    ----------
    home
        Results folder of the campaign.
    jobs
        Number of jobs whose notes were read.
    checked
        Number of results compared, by folder of the stage ("" for the results folder itself).
    changed
        Results that have changed since their job wrote them.
    missing
        Results that no longer exist; the campaign regenerates them if they are needed.
    """

    home: Path
    jobs: int
    checked: Mapping[str, int]
    changed: list[Path]
    missing: list[Path]

    def as_json(self) -> dict[str, Any]:
        """Return the comparison as `coronaryuq verify --json` prints it (docs/reference/formats.md)."""
        return {
            "folder": self.home.as_posix(),
            "jobs": self.jobs,
            "verified": sum(self.checked.values()),
            "by_folder": dict(self.checked),
            "changed": [path.as_posix() for path in self.changed],
            "missing": [path.as_posix() for path in self.missing],
        }

    def __str__(self) -> str:
        of_what = ", ".join(f"{count} in {folder or 'the folder itself'}" for folder, count in self.checked.items())
        gone = f"; {len(self.missing)} no longer there" if self.missing else ""
        unchanged = sum(self.checked.values()) - len(self.changed)
        return (
            f"{self.home.name}: {unchanged} of {sum(self.checked.values())} results of {self.jobs} jobs are unchanged "
            f"since their jobs wrote them{gone} ({of_what or 'none'})"
        )


def verify(home: str | Path) -> Verified:
    """Compare the results of a campaign with the checksums in the notes of their jobs.

    Files that no note mentions are ignored.

    Raises
    ------
    InputError
        If the folder holds no notes.
    """
    home = Path(os.path.abspath(home))
    if not (home / FOLDER).is_dir():
        raise InputError(home, None, None, f"no folder {FOLDER}/ in it; name the results folder of a campaign")
    newest: dict[str, tuple[str, str]] = {}
    every = list(notes(home / FOLDER))
    for note in every:
        for name, content in note["results"].items():
            newest[name] = max(newest.get(name, ("", "")), (note["made"], content))
    expected = {home.parents[1] / name: content for name, (_, content) in sorted(newest.items())}
    there = {path: content for path, content in expected.items() if path.exists()}
    folders = Counter(next(iter(path.relative_to(home).parts[:-1]), "") for path in there)
    changed = [path for path, content in there.items() if checksum(path) != content]
    return Verified(home, len(every), dict(sorted(folders.items())), changed, [p for p in expected if p not in there])


def remove_changed(home: str | Path) -> Verified:
    """Delete the results of a campaign that have changed since their jobs wrote them, and return the verified results.

    Raises
    ------
    InputError
        If the folder holds no notes, or a campaign is running in it.
    """
    found = verify(home)
    with lock_results(home):
        for path in found.changed:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    return found


def _note(home: Path, path: Path, name: str) -> tuple[dict, str]:
    """Return the note about a result, and the entry of its `results` that is the file or a folder that contains it."""
    every = list(notes(home / FOLDER))
    parents = [name, *(parent.as_posix() for parent in Path(name).parents)]
    # The latest note counts: with more samples, a job of the same name may have run a larger portion.
    found = [(note, entry) for note in every for entry in parents if entry in note["results"]]
    if found:
        content = {entry: checksum(home.parents[1] / entry) for _, entry in found}
        return max(found, key=lambda pair: (content[pair[1]] == pair[0]["results"][pair[1]], pair[0]["made"]))
    cache = path.resolve().parent if path.is_symlink() else os.environ.get(CACHE)
    if cache and path.is_file():
        copy = Path(cache, CACHED, f"{checksum(path)}.json")
        if copy.is_file():
            note = read_json(copy)
            (entry,) = (e for e, content in note["results"].items() if content == copy.stem and _same_place(e, name))
            return note | {"results": {name: copy.stem}, "cached": entry}, name
    raise InputError(path, None, None, f"no note in {home / FOLDER} mentions this file; regenerate it")


def _same_place(one: str, other: str) -> bool:
    """Return whether two results have the same path within their campaigns."""
    return Path(one).parts[2:] == Path(other).parts[2:]


def notes(folder: Path) -> Iterator[dict]:
    """Yield the notes in a folder by file name; `InputError` if one is not a note."""
    for path in visible(folder, "*.json"):
        note = read_json(path)
        if not isinstance(note, dict) or not isinstance(note.get("results"), dict) or "made" not in note:
            raise InputError(path, None, None, "not a job's note; delete it and make its results again")
        yield note


def _campaign_folder(path: str | Path) -> Path | None:
    """Return the folder `results/NAME` that contains a path."""
    parts = Path(path).parts
    for k in range(len(parts) - 2, -1, -1):
        if parts[k] == "results":
            return Path(*parts[: k + 2])
    return None


def _behind(params: Mapping[str, Any]) -> str:
    """Return the function of a job and the digest of its code, if its rule has them."""
    return f"; {params['function']}, code digest {params['code']}" if {"function", "code"} <= params.keys() else ""


def _state(path: Path, content: str) -> str:
    if not path.exists():
        return "missing"
    return UNCHANGED if checksum(path) == content else "has changed since"


def remake(note: Mapping[str, Any], entry: str, home: Path) -> str:
    """Return the shell command that reproduces a result, from any folder."""
    folder = home.parents[1]
    snakefile = Path(note.get("snakefile", shipped.snakefile()))
    where = [] if snakefile == folder / "workflow" / "Snakefile" else ["--snakefile", snakefile.as_posix()]
    program = Path(sys.executable).parent / "snakemake"
    if program.is_relative_to(folder):
        program = program.relative_to(folder)
    words = [program.as_posix(), *where, "--cores", "all"]
    words += ["--configfile", f"results/{home.name}/{CAMPAIGN}", "--force", "--", entry]
    return f"cd {shlex.quote(folder.as_posix())} && {shlex.join(words)}"


def _solvers(path: Path) -> list[str]:
    """Return the solvers named in the records of a batch."""
    if path.suffix != ".jsonl":
        return []
    from coronaryuq.core import records

    return sorted({", ".join(record.solver.values()) for record in records.read(path)})


def _indented(value: Any) -> list[str]:
    text = yaml.safe_dump(value, sort_keys=False, allow_unicode=True, width=110)
    return [f"  {line}" for line in text.splitlines()]


def _flat(values) -> list[str]:
    return [path for value in values for path in ([value] if isinstance(value, str) else value)]


def _plain(value: Any) -> Any:
    """Return parameters as JSON stores them."""
    return json.loads(json.dumps(value, default=str))
