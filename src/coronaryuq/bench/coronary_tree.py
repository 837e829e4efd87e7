"""A closed loop with a synthetic coronary tree, for benchmarks without a patient's network."""

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel
from coronaryuq.case.network.build import Bed, Physics, network_from_tree
from coronaryuq.case.network.network import Network
from coronaryuq.case.settings import MURRAY_EXPONENT

LEFT, RIGHT = 12, 10
"""Outlets of the left and of the right coronary artery."""

END_RADIUS, LENGTH, NARROWEST = 0.06, 2.0, 0.6
"""Radius of the outlets and length of the vessels, cm; radius of a stenosis relative to the healthy vessel."""


def synthetic_loop(
    left: int = LEFT, right: int = RIGHT, end_radius: float = END_RADIUS, stenosed: bool = True
) -> Network:
    """Return an aorta with two bifurcating trees, radii by Murray's law; 50 vessels at 22 outlets.

    Parameters
    ----------
    left, right
        Number of outlets of the left and of the right coronary artery.
    end_radius
        Radius of the outlets, cm.
    stenosed
        Whether LAD, LCx and RCA have a stenosis.
    """
    vessels = [
        _straight("aorta", np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.2, None, "aorta"),
        _straight("aorta_end", np.array([0.0, 0.0, LENGTH]), np.array([0.0, 0.0, 1.0]), 1.2, "aorta", "aorta"),
    ]
    beds: list[Bed] = []
    _grow(vessels, beds, "lca", left, end_radius, 0.0, np.pi, "LM")
    _grow(vessels, beds, "rca", right, end_radius, np.pi, np.pi, "RCA")
    stenoses = []
    for artery, place in (("LAD", "lca0"), ("LCx", "lca1"), ("RCA", "rca0")) if stenosed else ():
        index = next(k for k, vessel in enumerate(vessels) if vessel.name == place)
        stenoses.append(Stenosis(artery, place, 0.5 * LENGTH, 0.75 * LENGTH))
        vessels[index] = _narrowed(vessels[index], stenoses[-1])
    return network_from_tree(Tree(vessels), beds, {"BC_RCR1": "aorta_end"}, stenoses, Physics())


def _grow(
    vessels: list, beds: list, name: str, outlets: int, end: float, angle: float, spread: float, branch: str
) -> None:
    parent = next(v for v in vessels if v.name == (name[:-1] or name)) if name[-1].isdigit() else vessels[0]
    direction = np.array([np.cos(angle), np.sin(angle), 0.0])
    radius = end * outlets ** (1.0 / MURRAY_EXPONENT)
    vessels.append(_straight(name, parent.points[-1], direction, radius, parent.name, branch))
    if outlets == 1:
        beds.append(Bed(f"BC_{name}", name, branch == "RCA"))
        return
    for side, share in enumerate((outlets - outlets // 2, outlets // 2)):
        artery = ("LAD", "LCx")[side] if branch == "LM" else branch
        _grow(vessels, beds, f"{name}{side}", share, end, angle + (side - 0.5) * spread / 2, spread / 2, artery)


def _straight(name: str, start, direction, radius: float, parent: str | None, branch: str) -> Vessel:
    share = np.linspace(0.0, 1.0, 41)
    return Vessel(name, start + share[:, None] * LENGTH * direction, np.full(41, radius), parent, branch)


def _narrowed(vessel: Vessel, stenosis: Stenosis) -> Vessel:
    along = np.clip((vessel.arc - stenosis.start) / (stenosis.end - stenosis.start), 0.0, 1.0)
    factor = 1.0 - (1.0 - NARROWEST) * np.sin(np.pi * along) ** 2
    return Vessel(vessel.name, vessel.points, vessel.radii * factor, vessel.parent, vessel.branch)
