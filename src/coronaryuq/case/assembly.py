"""Assemble a case from its description: read every file, match all names, build or adopt the 0D network."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from coronaryuq.case.anatomy.dominance import find_dominance, handedness_notes
from coronaryuq.case.anatomy.ffr_place import ffr_notes, with_ffr_places
from coronaryuq.case.anatomy.read import PlacedOutlets, place_outlets, place_stenoses, read_anatomy
from coronaryuq.case.anatomy.tree import Stenosis, Tree
from coronaryuq.case.anatomy.wire_places import locate_wire_places
from coronaryuq.case.case_json import (
    AnatomySource,
    Aorta,
    CaseOutlet,
    CaseSummary,
    Dominance,
    TargetValue,
)
from coronaryuq.case.description.dependencies import check_files
from coronaryuq.case.description.fields import Description, read_description
from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.case.lumen.implied import implied_lumen
from coronaryuq.case.lumen.law import lumen_law
from coronaryuq.case.lumen.narrowest_place import with_exact_throats
from coronaryuq.case.lumen.profiles import with_lumen
from coronaryuq.case.network.along_tree import vessels_along
from coronaryuq.case.network.build import Bed, Physics, murray_shares, network_from_tree
from coronaryuq.case.network.network import Network
from coronaryuq.case.network.schematic import schematic_tree
from coronaryuq.case.network.stenoses import case_stenoses
from coronaryuq.case.network.topology import CORONARY, SYSTEMIC, Topology, closed_loop_tree
from coronaryuq.case.network.units import to_cgs
from coronaryuq.case.perfusion.outlet_checks import outlet_notes
from coronaryuq.case.perfusion.perfusion_map import Wall, read_wall
from coronaryuq.case.perfusion.place import check_place
from coronaryuq.case.perfusion.territories import wall_of_territories
from coronaryuq.case.settings import Settings, Uncertainty
from coronaryuq.case.sketch import Sketch
from coronaryuq.case.tables.needed_targets import complete_targets, heart_period
from coronaryuq.case.tables.read import OutletRow, read_case_targets, read_outlets, read_territory_flows
from coronaryuq.case.unusual_sizes import size_notes
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.units import LENGTHS, MM, MMHG, PRESSURES

AORTIC_PRESSURE_WITHOUT_TARGET = 93.0 * MMHG
DEFAULT_PERIOD = 1.0
"""s."""


@dataclass(frozen=True)
class AssembledCase:
    """A checked case; without an anatomy, the tree is a schematic of the case's network and `stenoses` is empty."""

    description: Description
    tree: Tree
    stenoses: list[Stenosis]
    network: Network
    topology: Topology
    summary: CaseSummary
    wall: Wall


def assemble(
    case_yaml: str | Path, settings: Settings, uncertainty: Uncertainty = "paper", sketch: Sketch | None = None
) -> AssembledCase:
    """Read a case and all files that it refers to.

    Parameters
    ----------
    case_yaml : str or Path
        The case's description.
    settings : Settings
        Settings of the case stage.
    uncertainty : "full" or "paper"
        Whether the network's lumen is uncertain, or known as in the paper.
    sketch : Sketch
        Receives what was understood, also if a fault is found later.

    Returns
    -------
    AssembledCase
        Tree, network, wall and summary of the case, checked against one another.

    Raises
    ------
    InputError
        At the first fault.
    """
    path = Path(case_yaml)
    description = read_description(path)
    check_files(path, description)
    folder = path.parent
    sketch = sketch or Sketch()
    try:
        rows = read_outlets(folder / description.outlets)
    except InputError:
        if description.network is not None and description.anatomy is None:
            _sketch_network(sketch, folder, description)
        raise
    sketch.rows, sketch.unit = rows, None if description.anatomy is None else description.length_unit
    targets = read_case_targets(folder / description.targets) if description.targets else {}
    own_network = _read_own_network(folder, description)
    targets_file = folder / description.targets if description.targets else path
    period = heart_period(targets, description.period, targets_file)
    period, period_notes = (period, ()) if period else _assumed_period(own_network and own_network[0])
    targets, target_notes = complete_targets(targets, period, targets_file)
    notes: tuple[str, ...] = ()
    tree: Tree | None = None
    placed: PlacedOutlets | None = None
    stenoses: list[Stenosis] = []
    anatomy = description.anatomy
    if anatomy is not None:
        tree, notes = read_anatomy(path, description, anatomy, rows, settings)
        sketch.tree = tree
        tree, placed = place_outlets(path, description, tree, rows, notes)
        sketch.tree, sketch.placed = tree, placed
        stenoses, stenosis_notes = place_stenoses(path, description, tree, placed.labels, settings)
        if description.ffr_beyond_mm is not None:
            stenoses = with_ffr_places(tree, stenoses, description.ffr_beyond_mm * MM)
        notes += placed.notes + stenosis_notes + ffr_notes(stenoses)
        sketch.stenoses = stenoses
    if own_network is None:
        assert tree is not None and placed is not None  # a description has an anatomy, a network, or both
        physics = _physics(description, settings, targets, period)
        network = _built_network(path, tree, placed, stenoses, physics)
        topology = closed_loop_tree(network, path)
    else:
        network, topology, unit = own_network
        network.heart["cardiac_cycle_period"] = period
        _match(path, folder / description.outlets, description, rows, topology)
        if tree is None:
            if description.perfusion is not None:
                _require_points(folder / description.outlets, rows)
            tree = schematic_tree(topology, description.density, {row.bc: row.branch for row in rows})
            notes = ("no anatomy: tree.vtp is a schematic of the network; only its lengths and radii are real",)
        if unit != "cgs":
            notes += (f"{description.network}: pressures in {unit}, converted to dyn/cm2",)
    outlets = _outlets(rows, placed, tree, topology)
    sketch.tree, sketch.outlets = tree, outlets
    sketch.wire_places = locate_wire_places(path, description, tree, outlets)
    if uncertainty == "full":
        network = _with_uncertain_lumen(path, description, tree, stenoses, network, topology)
    if description.perfusion is not None:
        wall = read_wall(path, description.perfusion, description.tissue_density, settings.wall_cells)
        sketch.wall = wall
        if description.perfusion.registration is not None:
            scan = folder / description.perfusion.registration.fixed
            sketch.scan = (scan, LENGTHS[description.perfusion.length_unit])
        notes += check_place(path, description.perfusion, wall, outlets)
    elif description.territory_flows is not None:
        lv = {row.name: row.bc for row in rows if row.perfuses == "LV"}
        flows = read_territory_flows(path, description.territory_flows, lv, description.tissue_density)
        by_radius = murray_shares([outlet.radius for outlet in outlets], settings.murray_exponent).tolist()
        shares = dict(zip([outlet.name for outlet in outlets], by_radius, strict=True))
        wall = wall_of_territories(outlets, flows, description.tissue_density, shares)
    notes += outlet_notes(wall, outlets, description.tissue_density)
    notes += size_notes(tree, wall, description.tissue_density)
    if anatomy is not None:
        notes += handedness_notes(tree, {outlet.vessel: outlet.branch for outlet in outlets})
    summary = CaseSummary(
        name=description.name,
        description=description.description,
        period=period,
        density=description.density,
        viscosity=description.blood_viscosity,
        haematocrit=description.haematocrit,
        hyperaemia=description.hyperaemia,
        tissue_density=description.tissue_density,
        murray_exponent=settings.murray_exponent,
        schematic=anatomy is None,
        anatomy=None if anatomy is None else AnatomySource(kind=anatomy.kind, unit=anatomy.unit),
        aorta=Aorta(pressure=topology.inlet(topology.roots[0]), made=any(vessel.made for vessel in tree)),
        outlets=outlets,
        systemic=[bc for bc in topology.vessel_of if topology.kind(bc) == SYSTEMIC],
        stenoses=case_stenoses(path, description, tree, stenoses, topology, outlets),
        ffr_at=sketch.wire_places,
        dominance=None if anatomy is None else _dominance(tree, outlets),
        targets=targets,
        errors=(description.errors or RoutineErrors()) if uncertainty == "full" else None,
        notes=[*notes, *period_notes, *target_notes, *wall.notes],
    )
    return AssembledCase(description, tree, stenoses, network, topology, summary, wall)


def _dominance(tree: Tree, outlets: list[CaseOutlet]) -> Dominance | None:
    return find_dominance(tree, {o.vessel: o.branch for o in outlets}, {o.vessel: o.label for o in outlets})


def _with_uncertain_lumen(
    path: Path, description: Description, tree: Tree, stenoses: list[Stenosis], network: Network, topology: Topology
) -> Network:
    if description.anatomy is None:
        implied = implied_lumen(tree, topology, description.density, description.blood_viscosity)
        tree, stenoses, along = implied.tree, implied.stenoses, implied.segments
    else:
        along = vessels_along(tree, stenoses, network, description.network or "network")
    error = description.lumen or LumenError()
    try:
        law = lumen_law(tree, stenoses, error)
    except ValueError as wrong:
        raise InputError(path, "lumen.calcified", None, str(wrong)) from None
    return with_lumen(network, tree, along, with_exact_throats(law, tree, stenoses, MM * error.length))


def _read_own_network(folder: Path, description: Description) -> tuple[Network, Topology, str] | None:
    """Return the case's own network in CGS, its topology, and its original pressure unit."""
    if description.network is None:
        return None
    path = folder / description.network
    content = read_json(path)
    closed_loop_tree(content, path)
    _check_resistances(Network(content), path)
    network, unit = to_cgs(Network(content), description.network_units, path)
    return network, closed_loop_tree(network, path), unit


def _check_resistances(network: Network, path: Path) -> None:
    """Raise InputError for a negative resistance, which a 0D solver accepts: no vessel or bed of a patient has one."""
    parts = {"vessels": ("vessel_name", "zero_d_element_values"), "boundary_conditions": ("bc_name", "bc_values")}
    for part, (name, kind) in parts.items():
        for block in network.get(part, []):
            values = block.get(kind)
            for key, value in values.items() if isinstance(values, dict) else ():
                if key.startswith("R") and isinstance(value, int | float) and value < 0:
                    remedy = "a resistance cannot be negative; correct it, or set it to 0"
                    raise InputError(path, f"{part}.{block.get(name)}.{kind}.{key}", value, remedy)


def _sketch_network(sketch: Sketch, folder: Path, description: Description) -> None:
    """Give the sketch a network whose outlets table has a fault, so that its beds are seen where they are asked for."""
    try:
        own_network = _read_own_network(folder, description)
    except InputError:  # told once the table is sound
        return
    if own_network is not None:
        topology = own_network[1]
        beds = {bc: vessel for bc, vessel in topology.vessel_of.items() if topology.kind(bc) in CORONARY}
        sides = {bc: "RCA" if CORONARY[topology.kind(bc)] else "LM" for bc in beds}
        sketch.tree = schematic_tree(topology, description.density, sides)
        sketch.beds = {vessel: bc.removeprefix("BC_") for bc, vessel in beds.items()}


def _assumed_period(network: Network | None) -> tuple[float, tuple[str, ...]]:
    """Return the period of a given network, else the default, and a note that it is not the patient's heart rate."""
    stated = None if network is None else network.heart.get("cardiac_cycle_period")
    period, origin = (float(stated), "that of the network") if stated else (DEFAULT_PERIOD, "assumed")
    rate = f"{60.0 / period:.3g} beats per minute"
    return period, (f"heart rate is not given: a period of {period:.3g} s ({rate}), {origin}; give HR (1/min)",)


def _physics(
    description: Description, settings: Settings, targets: Mapping[str, TargetValue], period: float
) -> Physics:
    def target(name: str) -> float | None:
        entry = targets.get(name)
        return None if entry is None or entry.value is None else entry.value * PRESSURES.get(entry.unit or "", 1.0)

    stroke, split = target("AbsQin"), target("AorCorSplit")
    return Physics(
        density=description.density,
        viscosity=description.blood_viscosity,
        stenosis_loss=settings.stenosis_loss,
        kinetic_factor=settings.kinetic_factor,
        elastic=settings.walls == "elastic",
        young=settings.young,
        thickness_ratio=settings.thickness_ratio,
        murray_exponent=settings.murray_exponent,
        pressure=target("PaoMean") or AORTIC_PRESSURE_WITHOUT_TARGET,
        cardiac_output=stroke / period if stroke else Physics.cardiac_output,
        coronary_share=split / 100.0 if split else settings.coronary_share,
        period=period,
    )


def _built_network(
    path: Path, tree: Tree, placed: PlacedOutlets, stenoses: list[Stenosis], physics: Physics
) -> Network:
    beds = [Bed(row.bc, placed.vessels[row.name], row.branch == "RCA") for row in placed.rows]
    try:
        return network_from_tree(tree, beds, placed.systemic, stenoses, physics)
    except ValueError as error:
        raise InputError(path, "anatomy", None, str(error)) from None


def _match(path: Path, table: Path, description: Description, rows: list[OutletRow], topology: Topology) -> None:
    """Check that the outlets table and the given network have the same coronary beds."""
    network = description.network
    coronary = {bc: CORONARY[topology.kind(bc)] for bc in topology.vessel_of if topology.kind(bc) in CORONARY}
    for row in rows:
        if row.bc not in coronary:
            raise InputError(table, "bc", row.bc, f"{network} has no such coronary bed; it has {', '.join(coronary)}")
        if coronary[row.bc] != (row.branch == "RCA"):
            side = "right" if coronary[row.bc] else "left"
            raise InputError(table, f"branch of {row.name}", row.branch, f"{row.bc} is a {side} bed in {network}")
    for bc in coronary:
        if bc not in {row.bc for row in rows}:
            raise InputError(table, "bc", bc, f"missing; {network} has this coronary bed")
    for outlet in description.systemic_outlets:
        if outlet.name not in topology.blocks or topology.kind(outlet.name) != SYSTEMIC:
            raise InputError(path, "systemic_outlets.name", outlet.name, f"{network} has no {SYSTEMIC} of this name")


def _require_points(table: Path, rows: list[OutletRow]) -> None:
    for row in rows:
        if row.perfuses == "LV" and row.point is None:
            raise InputError(
                table, f"x y z of {row.name}", None, "missing; needed to find its territory in the perfusion map"
            )


def _outlets(rows: list[OutletRow], placed: PlacedOutlets | None, tree: Tree, topology: Topology) -> list[CaseOutlet]:
    entries = []
    for row in rows:
        block = topology.vessel_of[row.bc]
        vessel = tree[block if placed is None else placed.vessels[row.name]]
        end = vessel.points[-1] if placed is not None or row.point is None else row.point
        entries.append(
            CaseOutlet(
                name=row.name,
                label=row.label,
                bc=row.bc,
                vessel=vessel.name,
                block=block,
                perfuses=row.perfuses,
                branch=row.branch,
                point=tuple(float(x) for x in end),
                radius=float(vessel.radii[-1]),
            )
        )
    return entries
