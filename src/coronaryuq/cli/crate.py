"""`coronaryuq crate`: pack a campaign with its workflow, inputs, results and provenance as an RO-Crate."""

import argparse
import json
import os
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import coronaryuq
from coronaryuq.campaign import explain
from coronaryuq.cli.crate_metadata import Credits, Packed, describe
from coronaryuq.core import shipped
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import check_file, check_folder, replacing

METADATA = "ro-crate-metadata.json"
INPUTS = "inputs"
"""Folder in the crate for input files from outside the folder that the campaign ran in."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `coronaryuq crate`."""
    parser.description = (
        "Pack a campaign as a Provenance Run Crate: workflow, configuration, inputs, results and records of its jobs."
    )
    parser.add_argument("results", metavar="FOLDER", help="results folder of a campaign, results/NAME")
    parser.add_argument("--out", metavar="PATH", help="a new folder, or a file NAME.zip (default: NAME.crate.zip)")
    parser.add_argument("--no-data", action="store_true", help="describe inputs and results without including them")
    parser.add_argument("--agent", metavar="NAME", help="person who ran the campaign")
    parser.add_argument("--orcid", metavar="URL", help="ORCID of that person, https://orcid.org/...")
    parser.add_argument("--license", metavar="URL", help="licence of the data (default: none is granted)")


def main(options: argparse.Namespace) -> int:
    """Write the crate and print where it is."""
    home = Path(os.path.abspath(options.results))
    out = Path(options.out or f"{home.name}.crate.zip")
    if options.orcid and not (options.agent and options.orcid.startswith("https://orcid.org/")):
        raise InputError("command line", "--orcid", options.orcid, "give --agent NAME and a URL https://orcid.org/...")
    write_crate(home, out, Credits(options.agent, options.orcid, options.license), data=not options.no_data)
    print(f"Crate: {out}")
    return 0


def write_crate(home: Path, out: Path, credits: Credits, data: bool = True) -> None:
    """Write the crate of a campaign; the same campaign gives the same bytes.

    Parameters
    ----------
    home
        Results folder of the campaign.
    out
        A file `NAME.zip`, which is replaced, or a folder, which must not exist or be empty.
    credits
        Person who ran the campaign, and licence of its data.
    data
        Whether to copy inputs and results.

    Raises
    ------
    InputError
        If the folder is no campaign, or if a result or an input has changed since its job ran.
    """
    zipped = out.suffix == ".zip"
    if zipped:
        check_file(out)
    elif check_folder(out).exists() and any(out.iterdir()):
        raise InputError(out, None, None, "already there; name a new folder, or a file NAME.zip")
    campaign = read(home)
    files = campaign.carried | (campaign.data if data else {})
    metadata = describe(campaign, files, credits)
    if zipped:
        _zip(out, files, metadata, max(note["made"] for note in campaign.notes))
    else:
        _folder(out, files, metadata)


def read(home: Path) -> Packed:
    """Read the notes of a campaign and assign each of its files a place in the crate.

    Raises
    ------
    InputError
        If the folder is no campaign, or if a result or an input has changed since its job ran.
    """
    if changed := explain.verify(home).changed:
        remedy = f"changed since its job wrote it ({len(changed)} such results); run the campaign again"
        raise InputError(changed[0], None, None, remedy)
    if not (home / explain.CAMPAIGN).is_file():
        raise InputError(home, None, None, f"no {explain.CAMPAIGN} in it; name the results folder of a campaign")
    notes = sorted(explain.notes(home / explain.FOLDER), key=lambda note: (note["made"], note["job"]))
    if not notes:
        raise InputError(home, None, None, "no job has finished; run the campaign first")
    names = _Names(home, notes)
    made = {name for note in notes for name in note["results"]}
    data = {name: home.parents[1] / name for name in sorted(made) if (home.parents[1] / name).exists()}
    for note in notes:
        for path, content in note["inputs"].items():
            name = names.of(path)
            if name is not None and made.isdisjoint([name, *map(str, Path(name).parents)]):
                data[name] = _input(home.parents[1] / path, content, note["job"])
    return Packed(home.name, notes, names.of, _carried(home), dict(sorted(data.items())))


def _input(path: Path, content: str, job: str) -> Path:
    if not path.exists():
        raise InputError(path, None, None, f"an input of {job} that is no longer there; put it back")
    if explain.checksum(path) != content:
        raise InputError(path, None, None, f"changed since {job} read it; run the campaign again")
    return path


class _Names:
    """Names of files in the crate: relative to the folder in which the campaign ran, so that it can be rerun there."""

    def __init__(self, home: Path, notes: list[dict]):
        self.folder = home.parents[1]
        self.package = Path(coronaryuq.__file__).parent
        outside = {self._absolute(path).parent for note in notes for path in note["inputs"] if self._is_outside(path)}
        self.common = Path(os.path.commonpath(outside)) if outside else None

    def of(self, path: str) -> str | None:
        """Return the name of a file; None if it is part of the package."""
        if self._is_of_package(path):
            return None
        absolute = self._absolute(path)
        if absolute.is_relative_to(self.folder):
            return absolute.relative_to(self.folder).as_posix()
        return f"{INPUTS}/{absolute.relative_to(self.common or absolute.parent).as_posix()}"

    def _absolute(self, path: str) -> Path:
        return Path(os.path.abspath(self.folder / path))

    def _is_outside(self, path: str) -> bool:
        return not self._absolute(path).is_relative_to(self.folder) and not self._is_of_package(path)

    def _is_of_package(self, path: str) -> bool:
        """Whether a path is a template of the package, wherever it was installed when the job ran."""
        _, found, inside = path.rpartition(f"/{self.package.name}/")
        return bool(found) and (self.package / inside).is_file()


def _carried(home: Path) -> dict[str, Path]:
    """Return the files of every crate: workflow, configuration, notes, logs, licence and citation."""
    package = shipped.snakefile().parents[1]
    files = {path.relative_to(package).as_posix(): path for path in _files(package / "workflow")}
    files |= {name: package / name for name in ("LICENSE", "CITATION.cff")}
    folders = (home / explain.FOLDER, home / "logs")
    own = [home / explain.CAMPAIGN, *(path for folder in folders for path in _files(folder))]
    files |= {path.relative_to(home.parents[1]).as_posix(): path for path in own}
    return dict(sorted(files.items()))


def _files(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder without temporary files of Python and Snakemake."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts and path.name != ".snakemake_timestamp":
            yield path


@dataclass
class _Entry:
    name: str
    source: Path


def _entries(files: Mapping[str, Path]) -> Iterator[_Entry]:
    """Yield every single file; those of a folder one by one."""
    for name, source in files.items():
        if source.is_dir():
            for path in _files(source):
                yield _Entry(f"{name}/{path.relative_to(source).as_posix()}", path)
        else:
            yield _Entry(name, source)


def _folder(out: Path, files: Mapping[str, Path], metadata: Mapping) -> None:
    out.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=f".{out.name}.", suffix=".part", dir=out.parent))
    try:
        part.chmod(0o755)
        for entry in _entries(files):
            target = part / entry.name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(entry.source, target)
        (part / METADATA).write_text(_text(metadata), encoding="utf-8")
        os.replace(part, out)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _zip(out: Path, files: Mapping[str, Path], metadata: Mapping, made: str) -> None:
    date = datetime.fromisoformat(made).timetuple()[:6]
    with replacing(out) as part, zipfile.ZipFile(part, "w") as archive:
        archive.writestr(_info(METADATA, date), _text(metadata))
        for entry in _entries(files):
            with open(entry.source, "rb") as source, archive.open(_info(entry.name, date), "w", force_zip64=True) as to:
                shutil.copyfileobj(source, to, 1 << 20)


def _info(name: str, date: tuple) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name, date)
    info.compress_type = zipfile.ZIP_DEFLATED
    info.external_attr = 0o644 << 16
    return info


def _text(metadata: Mapping) -> str:
    return json.dumps(metadata, indent=1, ensure_ascii=False) + "\n"
