"""A draft of `case.yaml`: outlets with their roles, stenoses, and notes on what was taken for granted."""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from coronaryuq.case.anatomy.closed_lumen import AORTIC
from coronaryuq.case.anatomy.dominance import find_dominance
from coronaryuq.case.anatomy.read import place_outlets, read_anatomy
from coronaryuq.case.anatomy.stenosis_detection import detected_stenoses
from coronaryuq.case.anatomy.tree import AORTA, Tree, area_ratio
from coronaryuq.case.anatomy.vessel_names import course, natural_key
from coronaryuq.case.anatomy.wire_places import distance_from_ostium
from coronaryuq.case.case_json import Branch, Dominance, Point, Tissue
from coronaryuq.case.description.fields import Anatomy, Description, SystemicOutlet, TerritoryFlows
from coronaryuq.case.draft.labels import BRANCHES, artery_of, free_name, label_ends, tissue_of
from coronaryuq.case.draft.source import End, Source
from coronaryuq.case.network.topology import CORONARY, Topology, closed_loop_tree
from coronaryuq.case.settings import Settings
from coronaryuq.case.tables.read import OutletRow
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.units import LENGTHS, percent

CASE, OUTLETS, FLOWS, TARGETS = "case.yaml", "outlets.csv", "flows.csv", "targets.csv"


@dataclass(frozen=True)
class DraftRow:
    """One row of `outlets.csv`; None for a cell that the user has to fill. `point`: in the anatomy's unit."""

    name: str
    label: str
    branch: Branch | None
    perfuses: Tissue | None
    vessel: str | None = None
    point: Point | None = None
    bc: str | None = None
    named: bool = False


@dataclass(frozen=True)
class DraftStenosis:
    """A narrowing that was found: its entry in `case.yaml`, and the fraction of the area that it takes."""

    entry: dict[str, Any]
    narrowing: float

    def __str__(self) -> str:
        entry = self.entry
        place = f"vessel {entry['vessel']}, {entry['start']:.2f} to {entry['end']:.2f} cm"
        return f"{entry['name']}: {place}, {percent(self.narrowing)} of the area"


@dataclass(frozen=True)
class Draft:
    """What can be read off an anatomy or a network.

    Attributes
    ----------
    source
        Where it is from.
    unit
        Length unit of an anatomy.
    rows
        Coronary outlets.
    stenoses
        Narrowings that were found.
    wire_place
        Example of an entry of `ffr_at`, whose measured value is invented; None for a network.
    dominance
        Which artery feeds the back of the heart, None where that is not to be seen.
    inlet, systemic
        Aortic inlet and outlets, where `case.yaml` has to name them.
    tree
        Vessels, cm; None for a network.
    notes
        What was taken for granted.
    """

    source: Source
    rows: list[DraftRow]
    unit: str | None = None
    stenoses: list[DraftStenosis] = field(default_factory=list)
    wire_place: dict[str, Any] | None = None
    dominance: Dominance | None = None
    inlet: Point | None = None
    systemic: list[dict[str, Any]] = field(default_factory=list)
    tree: Tree | None = None
    notes: tuple[str, ...] = ()


def draft_anatomy(source: Source, unit: str, aortic: Collection[str], settings: Settings) -> Draft:
    """Draft a case of an anatomy.

    Parameters
    ----------
    source
        Project, mesh, surface or centrelines.
    unit
        Its length unit.
    aortic
        Names of the ends (`Source.ends`) that are the aorta's.
    settings
        Settings of the case stage.

    Raises
    ------
    InputError
        If the vessels cannot be read.
    """
    ends = source.ends(unit)
    if source.kind in ("surface", "mesh"):
        return _of_lumen(source, unit, ends, aortic, settings)
    tree, notes = source.tree(unit)
    made = {v.name for v in tree if v.made}
    coronary = [end.name for end in ends if end.name not in aortic]
    _check_some(source, coronary)
    labels = label_ends(tree, coronary)
    rows, taken = [], set[str]()
    for vessel in (v.name for v in tree.leaves() if v.name in labels):
        end = labels[vessel]
        name = free_name(re.sub(r"[^A-Za-z0-9_.-]+", "_", vessel).lstrip("_.-") or "end", taken)
        rows.append(DraftRow(name, end.label, end.branch, end.perfuses, vessel, named=end.named))
    real = [end for end in ends if end.name in aortic and end.name not in made]
    systemic = [{"name": f"BC_RCR{k + 1}", "vessel": end.name} for k, end in enumerate(_if_narrow(real, ends, aortic))]
    return _with_stenoses(Draft(source, rows, unit, systemic=systemic, notes=notes), settings)


def _of_lumen(source: Source, unit: str, ends: list[End], aortic: Collection[str], settings: Settings) -> Draft:
    by_name = {end.name: end for end in ends}
    coronary: list[End] = []
    for piece in source.pieces:  # without an aorta, a piece begins at its widest end
        inside = [by_name[name] for name in piece]
        coronary += [end for end in inside if end.name not in aortic] if set(aortic) & {*piece} else inside[1:]
    _check_some(source, coronary)
    real = [end for end in ends if end.name in aortic]
    narrow = _if_narrow(real, ends, {end.name for end in ends} - {end.name for end in coronary})
    systemic = [{"name": f"BC_RCR{k + 1}", "point": _rounded(end.point)} for k, end in enumerate(narrow[1:])]
    inlet = _rounded(narrow[0].point) if narrow else None
    rows = [DraftRow(end.name, end.name, "LAD", "LV", point=_rounded(end.point)) for end in coronary]
    draft = Draft(source, rows, unit, inlet=inlet, systemic=systemic)
    tree, _ = read_anatomy(*_described(draft), settings)
    labels, taken = label_ends(tree, [row.name for row in rows], names_tell=False), set[str]()
    named = []
    for row in sorted(rows, key=lambda row: (_order(labels[row.name].branch), *natural_key(labels[row.name].label))):
        end = labels[row.name]
        named.append(DraftRow(free_name(end.label, taken), end.label, end.branch, end.perfuses, point=row.point))
    if tree.root.branch == AORTA and not tree.root.made:
        x, y, z = (float(value) / LENGTHS[unit] for value in tree.root.points[0])
        inlet = _rounded((x, y, z))
    return _with_stenoses(replace(draft, rows=named, inlet=inlet), settings)


def _check_some(source: Source, coronary: Collection) -> None:
    if not coronary:
        remedy = "no end is left for a coronary artery; are all of them the aorta's, or is the unit another?"
        raise InputError(source.path, "outlets", None, remedy)


def _order(branch: Branch | None) -> int:
    return len(BRANCHES) if branch is None else BRANCHES.index(branch)


def _if_narrow(real: list[End], ends: list[End], aortic: Collection[str]) -> list[End]:
    """Return the aortic ends if one of them is too narrow to be taken as one by its width, else none."""
    widest = max((end.radius for end in ends if end.name not in aortic), default=0.0)
    return real if any(end.radius < AORTIC * widest for end in real) else []


def _rounded(point: Point) -> Point:
    x, y, z = (round(value, 6) + 0.0 for value in point)
    return x, y, z


def _described(draft: Draft) -> tuple[Path, Description, Anatomy, list[OutletRow]]:
    """Return what the case stage will read of a draft's files, and the file to name in errors."""
    source, file = draft.source, draft.source.path.absolute()
    values = {source.kind: str(file), "unit": draft.unit, "inlet": draft.inlet, "groups": list(source.groups)}
    anatomy = Anatomy.model_validate(values)
    systemic = [SystemicOutlet.model_validate(entry) for entry in draft.systemic]
    flows = TerritoryFlows(file=FLOWS, unit="mL/min")
    description = Description(
        name="draft", anatomy=anatomy, outlets=OUTLETS, stenoses=[], territory_flows=flows, systemic_outlets=systemic
    )
    rows = [
        OutletRow(row.name, row.name, row.vessel, row.point, "LV", row.branch or "LAD", row.label) for row in draft.rows
    ]
    return file, description, anatomy, rows


def _with_stenoses(draft: Draft, settings: Settings) -> Draft:
    """Return the draft with its tree as the case stage will read it from the files, and the narrowings found there."""
    file, description, anatomy, rows = _described(draft)
    tree, notes = read_anatomy(file, description, anatomy, rows, settings)
    tree, placed = place_outlets(file, description, tree, rows)
    labels = placed.labels
    stenoses = [
        DraftStenosis(
            {"name": s.name, "vessel": s.vessel, "start": round(s.start, 3), "end": round(s.end, 3)},
            1.0 - area_ratio(tree, s),
        )
        for s in detected_stenoses(tree, settings.narrowing, settings.serial, labels)
    ]
    branches = {placed.vessels[row.name]: row.branch for row in draft.rows if row.branch is not None}
    return replace(
        draft,
        stenoses=stenoses,
        wire_place=_example_of_a_wire_place(tree, labels),
        dominance=find_dominance(tree, branches, labels),
        tree=tree,
        notes=notes + placed.notes,
    )


def _example_of_a_wire_place(tree: Tree, labels: Mapping[str, str]) -> dict[str, Any] | None:
    """Return an entry of `ffr_at`: three quarters down the first of LAD, LCx and RCA that the tree has."""
    for artery in BRANCHES:
        if vessels := course(tree, artery, labels):
            try:
                whole = distance_from_ostium(tree, vessels[-1].name, vessels[-1].length)
            except ValueError:  # it never leaves the aorta, which `check` tells
                continue
            return {"artery": artery, "distance": round(0.75 * whole, 1), "measured": 0.84, "sd": 0.02}
    return None


def draft_network(source: Source) -> Draft:
    """Draft a case of a 0D network: names and boundary conditions tell the arteries, as far as they do.

    Raises
    ------
    InputError
        If it is no closed loop with one tree of vessels.
    """
    topology = closed_loop_tree(read_json(source.path), source.path)
    rows, taken = [], set[str]()
    for bc, vessel in sorted(topology.vessel_of.items(), key=lambda entry: natural_key(entry[0])):
        if topology.kind(bc) not in CORONARY:
            continue
        right = CORONARY[topology.kind(bc)]
        name = free_name(bc.removeprefix("BC_"), taken)
        branch: Branch | None = "RCA" if right else _named_artery(topology, bc, vessel)
        own = f"BC_{name}" == bc
        perfuses = tissue_of(name, branch) or (None if right else "LV")
        rows.append(DraftRow(name, name, branch, perfuses, bc=None if own else bc, named=True))
    if not rows:
        raise InputError(source.path, "boundary_conditions", None, f"no coronary beds ({', '.join(CORONARY)})")
    return Draft(source, rows)


def _named_artery(topology: Topology, bc: str, vessel: str) -> Branch | None:
    """Return the left artery that the name of a bed, or of a vessel on the way to it, tells."""
    names = [bc.removeprefix("BC_"), *reversed(topology.path(vessel))]
    return next((found for name in names if (found := artery_of(name)) in ("LAD", "LCx")), None)
