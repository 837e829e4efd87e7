"""`coronaryuq init`: from a file with vessels to a folder with a case, its tables and a configuration."""

import argparse
import re
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from coronaryuq.case.anatomy.dominance import WORDS
from coronaryuq.case.description.yaml_file import read_yaml
from coronaryuq.case.draft.draft import CASE, Draft, draft_anatomy, draft_network
from coronaryuq.case.draft.perfusion import perfusion_entry
from coronaryuq.case.draft.source import End, Source, recognise
from coronaryuq.case.draft.write import README, Inputs, check_free, write_draft
from coronaryuq.case.settings import Settings
from coronaryuq.case.tables.read import read_case_targets
from coronaryuq.core import shipped
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import LENGTHS

LIKE = "laptop"
"""Configuration whose settings a new campaign starts with."""
OWN = ("name", "case", "paper_data", "discrepancy")
"""Settings of it that belong to the bundled patient."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `coronaryuq init`."""
    parser.description = (
        "Start a case of your own: read the vessels in PATH, and write case.yaml, its tables with blanks for what only "
        "you can know, a configuration, and a page on what to do next."
    )
    parser.add_argument(
        "path",
        metavar="PATH",
        help="a SimVascular project, a mesh-complete folder, a surface (STL, VTP), centrelines (VTP, CSV) or a 0D "
        "network (JSON)",
    )
    parser.add_argument("--into", metavar="FOLDER", help="folder to write to (default: NAME-case, NAME as in PATH)")
    parser.add_argument("--unit", choices=LENGTHS, help="length unit of PATH (default: the one that makes sense)")
    parser.add_argument("--group", action="append", default=[], help="contour group to use where a path has several")
    parser.add_argument("--perfusion", metavar="MAP", help="map of myocardial blood flow in hyperaemia")
    parser.add_argument("--targets", metavar="TABLE", help="table of clinical measurements")
    parser.add_argument("--yes", "-y", action="store_true", help="ask nothing: take what is most likely")


def main(options: argparse.Namespace) -> int:
    """Write a first case and print what was understood and what is left to do."""
    source = recognise(options.path, options.group)
    if options.group and source.kind != "simvascular":
        raise InputError("command line", "--group", ", ".join(options.group), "only a SimVascular project has groups")
    stem = source.path.absolute().name if source.path.is_dir() else source.path.name.split(".")[0]
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", stem).lstrip("_.-")[:60] or "patient"
    folder = Path(options.into or f"{name}-case")
    ask = None if options.yes or not sys.stdin.isatty() else input
    settings = Settings()
    perfusion = perfusion_entry(Path(options.perfusion), settings) if options.perfusion else None
    inputs = Inputs(perfusion, Path(options.targets) if options.targets else None)
    check_free(folder, inputs)
    if inputs.targets is not None:
        read_case_targets(inputs.targets)
    draft = draft_network(source) if source.kind == "network" else _drafted(source, options.unit, ask, settings)
    values = read_yaml(shipped.configuration(LIKE))
    campaign = {key: value for key, value in values.items() if key not in OWN}
    files = write_draft(folder, name, draft, inputs, campaign)
    for line in _told(draft):
        print(line)
    print(f"wrote {', '.join(files)} in {folder}")
    check = shlex.join(["coronaryuq", "check", str(folder / CASE)])
    print(f"next: fill in the blanks that {folder / README} lists, then {check}")
    return 0


def _drafted(source: Source, unit: str | None, ask: Callable[[str], str] | None, settings: Settings) -> Draft:
    try:
        unit = unit or _unit(source, ask)
        ends = source.ends(unit)
        aortic = _aortic(source, ends, unit, ask)
        draft = draft_anatomy(source, unit, aortic, settings)
    except InputError as error:
        if error.field == "path_name":
            remedy = error.remedy.replace("in anatomy.groups", "by --group")
            raise InputError(error.file, error.field, error.value, remedy) from None
        raise
    if draft.stenoses and ask is not None:
        draft = _stenoses(draft, ask)
    return draft


def _unit(source: Source, ask: Callable[[str], str] | None) -> str:
    units = source.units
    best = next(iter(units))
    if ask is None:
        return best
    shown = ", ".join(f"{20 * radius:.2g} mm wide in {unit}" for unit, radius in units.items())
    return _choice(ask, f"Length unit of {source.path}? The coronary ends are {shown}", list(LENGTHS), best)


def _choice(ask: Callable[[str], str], question: str, allowed: Sequence[str], default: str) -> str:
    while True:
        answer = ask(f"{question} [{default}]: ").strip() or default
        if answer in allowed:
            return answer
        print(f"one of {', '.join(allowed)}, please")


def _aortic(source: Source, ends: Sequence[End], unit: str, ask: Callable[[str], str] | None) -> set[str]:
    likely = [end.name for end in ends if end.aortic]
    if ask is None:
        return set(likely)
    print(f"Ends in {source.path}:")
    for number, end in enumerate(ends, start=1):
        place = ", ".join(f"{value:.4g}" for value in end.point)
        print(f"  {number}. {end.name}: {20 * end.radius:.1f} mm wide, at ({place}) {unit}")
    numbers = ", ".join(str(k) for k, end in enumerate(ends, start=1) if end.aortic)
    while True:
        answer = ask(f"Which are the aorta's (numbers, or none)? [{numbers or 'none'}]: ").strip()
        if not answer:
            return set(likely)
        if answer == "none":
            return set()
        words = re.split(r"[,\s]+", answer)
        if all(word.isascii() and word.isdigit() and 1 <= int(word) <= len(ends) for word in words):
            return {ends[int(word) - 1].name for word in words}
        print(f"numbers from 1 to {len(ends)}, please, such as 1, 2")


def _stenoses(draft: Draft, ask: Callable[[str], str]) -> Draft:
    kept = []
    for stenosis in draft.stenoses:
        if _choice(ask, f"Narrowing {stenosis}. Is it a stenosis?", ["y", "n"], "y") == "y":
            kept.append(stenosis)
    return replace(draft, stenoses=kept)


def _told(draft: Draft) -> list[str]:
    """Return what was understood, one line per part."""
    lines = []
    if draft.unit is not None:
        lines.append(f"{draft.source.kind}: {draft.source.path}, in {draft.unit}")
    for row in draft.rows:
        how = "" if row.named else " (from the course of the vessels; check it)"
        lines.append(f"outlet {row.name}: {row.branch or 'artery unknown'}, {row.perfuses or 'tissue unknown'}{how}")
    if draft.dominance is not None:
        lines.append(f"dominance: {WORDS[draft.dominance]}; check it")
    lines += [f"stenosis {stenosis}; check it" for stenosis in draft.stenoses]
    return lines + [f"note: {note}" for note in draft.notes]
