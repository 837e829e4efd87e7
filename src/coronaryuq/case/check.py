"""Summary of a checked case, for `coronaryuq check`."""

from collections import Counter

from coronaryuq.case.anatomy.dominance import WORDS
from coronaryuq.case.anatomy.stenosis_detection import example_stenosis
from coronaryuq.case.anatomy.tree import AORTA
from coronaryuq.case.anatomy.vessel_names import readable_names
from coronaryuq.case.assembly import AssembledCase
from coronaryuq.case.case_json import CaseWirePlace
from coronaryuq.case.perfusion.place import distances_to_outlets
from coronaryuq.case.tables.targets import BY_NAME, check_targets
from coronaryuq.core.units import MBF_PER_MIN_PER_G, ML_PER_MIN, percent


def describe(case: AssembledCase) -> list[str]:
    """Return the contents of a checked case, one line per part."""
    summary, wall = case.summary, case.wall
    flow = wall.flow(summary.tissue_density)
    mass = wall.volume * summary.tissue_density
    perfuses = Counter(outlet.perfuses for outlet in summary.outlets)
    lines = [
        f"case {summary.name}: period {summary.period:.3g} s, blood {summary.density:g} g/cm3, {summary.viscosity:g} P",
        f"network: {len(case.network.vessels)} vessels, {len(summary.outlets)} coronary outlets ("
        + ", ".join(f"{n} {kind}" for kind, n in sorted(perfuses.items()))
        + f"), {len(summary.systemic)} systemic",
        f"left ventricle: {wall.mesh.n_cells} cells, {wall.volume:.1f} mL of wall, {flow / ML_PER_MIN:.0f} mL/min, "
        f"{flow / mass / MBF_PER_MIN_PER_G:.2f} mL/min/g on average",
    ]
    if case.description.anatomy is not None:
        coronary = [vessel for vessel in case.tree if vessel.branch != AORTA]
        widest, narrowest = max(v.radii.max() for v in coronary), min(v.radii.min() for v in coronary)
        lines.insert(
            1,
            f"anatomy: {sum(v.length for v in coronary):.0f} cm of coronary arteries, {20 * narrowest:.1f} to "
            f"{20 * widest:.1f} mm in diameter",
        )
    if case.description.perfusion is not None:
        distances = distances_to_outlets(wall, summary.outlets)
        lines[-1] += f"; its outlets lie {distances.min():.1f} to {distances.max():.1f} cm from it"
    if summary.dominance is not None:
        lines.append(f"dominance: {WORDS[summary.dominance]}")
    readable = readable_names(case.tree, summary.outlets)
    for stenosis in summary.stenoses:
        ratio, start = stenosis.area_ratio, stenosis.start
        narrowing = (
            "" if ratio is None else f", {percent(1 - ratio)} of the area, {percent(1 - ratio**0.5)} of the diameter"
        )
        extent = "" if start is None else f", {start:.2f} to {stenosis.end:.2f} cm"
        own = readable.get(stenosis.vessel, stenosis.vessel)
        vessel = stenosis.vessel if own == stenosis.vessel else f"{stenosis.vessel} = {own}"
        lines.append(f"stenosis {stenosis.name}: vessel {vessel}{extent}{narrowing}")
    lines += [_wire_place(case, place) for place in summary.ffr_at]
    if case.description.anatomy is None:
        lines.append("no anatomy, so no 3D runs: only the target `posterior` can be run")
    elif not summary.stenoses:
        lines.append(
            "stenoses: none, so no 3D runs: only the target `posterior` can be run; for FFR and wall shear, name a "
            f"stretch of an artery, stenosed or not, such as stenoses: [{example_stenosis(case.tree)}]"
        )
    targets = check_targets(summary.targets, case.description.targets or "targets")
    values = [f"{name} {value:.4g} {BY_NAME[name].unit}".removesuffix(" 1") for name, value in targets.items()]
    lines.append(f"targets: {', '.join(values) or 'none'}")
    return lines + [f"note: {note}" for note in summary.notes]


def _wire_place(case: AssembledCase, place: CaseWirePlace) -> str:
    """Return where a place of a pressure wire was found, and what was measured there."""
    lesions = [s.name for s in case.stenoses if s.vessel == place.vessel and s.start < place.arc < s.end]
    diameter = 20 * float(case.tree[place.vessel].radius_at(place.arc))
    line = (
        f"FFR at {place.name}: {place.artery}, vessel {place.vessel} at {place.arc:.2f} cm, {place.distance:.2f} cm "
        f"from the ostium, {diameter:.1f} mm in diameter"
    )
    line += f", inside the {lesions[0]} stenosis" if lesions else ""
    if place.measured is None:
        return f"{line}; none measured"
    return f"{line}; measured {place.measured:g}" + ("" if place.sd is None else f" (sd {place.sd:g})")
