"""Where a pressure wire was read: a vessel of the tree and an arc length, from what `case.yaml` states."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from coronaryuq.case.anatomy.read import FARTHEST
from coronaryuq.case.anatomy.tree import AORTA, Tree, Vessel
from coronaryuq.case.anatomy.vessel_names import course, readable_names
from coronaryuq.case.case_json import Artery, CaseOutlet, CaseWirePlace
from coronaryuq.case.description.fields import ARTERIES, Description
from coronaryuq.case.description.wire_place import WirePlace
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import LENGTHS, MM

BEYOND = 1e-6
"""cm by which a distance may pass the end of its artery."""


def locate_wire_places(
    file: Path, description: Description, tree: Tree, outlets: Sequence[CaseOutlet]
) -> list[CaseWirePlace]:
    """Return the places of `ffr_at` on the tree.

    Parameters
    ----------
    file
        The `case.yaml`, named in errors.
    description
        Its content.
    tree
        Vessels with their branches, cm.
    outlets
        Coronary outlets of the case, whose labels tell the course of each artery.

    Raises
    ------
    InputError
        If an artery is not there, a distance passes its end, a point lies far from every artery, or two places have
        the same name.
    """
    names, labels = readable_names(tree, outlets), {outlet.vessel: outlet.label for outlet in outlets}
    located: list[CaseWirePlace] = []
    for number, place in enumerate(description.ffr_at):
        field = f"ffr_at.{number if place.name is None else place.name}"
        if place.artery is not None and place.distance is not None:
            vessel, arc = _by_distance(file, field, tree, labels, place.artery, place.distance)
        else:
            vessel, arc = _by_point(file, field, tree, place, LENGTHS[description.length_unit])
        distance = distance_from_ostium(tree, vessel, arc)
        name = place.name or f"{names[vessel]} {distance:.1f} cm"
        if any(other.name.lower() == name.lower() for other in located):
            raise InputError(file, field, name, "another place has this name; give each a name of its own")
        located.append(
            CaseWirePlace(
                name=name,
                artery=tree[vessel].branch,
                vessel=vessel,
                arc=arc,
                distance=distance,
                measured=place.measured,
                sd=place.sd,
            )
        )
    return located


def place_along(parts: Iterable[tuple[Vessel, float]], distance: float) -> tuple[str, float] | None:
    """Return vessel and arc length (cm) at a distance (cm) from the start of a course; None beyond its end.

    parts: the vessels of the course, each with the arc length (cm) at which it begins.
    """
    left = distance
    last: Vessel | None = None
    for last, begin in parts:
        if left <= last.length - begin:
            return last.name, begin + left
        left -= last.length - begin
    return (last.name, last.length) if last is not None and left <= BEYOND else None


def distance_from_ostium(tree: Tree, vessel: str, arc: float) -> float:
    """Return the distance (cm) along the centrelines from the ostium to an arc length (cm) of a coronary vessel."""
    parts = [v for v in tree.path(vessel) if v.branch != AORTA]
    return sum(v.length for v in parts[:-1]) + arc - sum(tree.emergence(v.name) for v in parts)


def _by_distance(
    file: Path, field: str, tree: Tree, labels: Mapping[str, str], artery: Artery, distance: float
) -> tuple[str, float]:
    vessels = course(tree, artery, labels)
    if not vessels:
        there = ", ".join(known for known in ARTERIES if any(v.branch == known for v in tree))
        raise InputError(
            file, f"{field}.artery", artery, f"the tree has no vessel of it; it has {there}; or give point"
        )
    parts = [(v, tree.emergence(v.name)) for v in vessels]
    found = place_along(parts, distance)
    if found is None:
        whole = sum(v.length - begin for v, begin in parts)
        remedy = f"beyond the end of the {artery}, {whole:.2f} cm from its ostium"
        remedy += f"; if {distance:g} is in mm, write {distance * MM:g}" if distance * MM <= whole else ""
        raise InputError(file, f"{field}.distance", distance, remedy)
    return found


def _by_point(file: Path, field: str, tree: Tree, place: WirePlace, scale: float) -> tuple[str, float]:
    point = np.array(place.point) * scale
    vessel, arc, away = tree.nearest(point, [v.name for v in tree if v.branch != AORTA])
    if away > max(FARTHEST, 2 * float(tree[vessel].radius_at(arc))):
        remedy = f"lies {away:.2g} cm from the nearest coronary artery ({vessel}); check the point and anatomy.unit"
        raise InputError(file, f"{field}.point", place.point, remedy)
    return vessel, max(arc, tree.emergence(vessel))
