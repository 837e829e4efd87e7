"""Whether each outlet gets a flow that its vessel can carry, asked before a campaign finds out."""

import math
from collections.abc import Sequence

import numpy as np

from coronaryuq.case.case_json import CaseOutlet
from coronaryuq.case.perfusion.perfusion_map import Wall
from coronaryuq.core.units import ML_PER_MIN

FASTEST = 200.0
"""cm/s: a mean velocity that no coronary artery reaches; under hyperaemia most have 30 to 100."""


def outlet_notes(wall: Wall, outlets: Sequence[CaseOutlet], tissue_density: float) -> tuple[str, ...]:
    """Return notes on what stops a campaign or is no artery's flow.

    These are a single outlet that perfuses the LV, an empty territory, and a flow that is too large for its vessel.

    Parameters
    ----------
    wall
        The left ventricle, with `Volume` (cm3) and `MBF` (mL/s/g).
    outlets
        All coronary outlets. The nearest of those that perfuse the LV feeds a cell, as in the paper.
    tissue_density
        Density of myocardium, g/mL.
    """
    from scipy.spatial import cKDTree

    feeding = [outlet for outlet in outlets if outlet.perfuses == "LV"]
    _, territory = cKDTree([outlet.point for outlet in feeding]).query(wall.mesh.cell_centers().points)
    mass = np.asarray(wall.mesh.cell_data["Volume"], dtype=float) * tissue_density
    flows = np.bincount(territory, weights=mass * wall.mesh.cell_data["MBF"], minlength=len(feeding))
    cells = np.bincount(territory, minlength=len(feeding))
    notes = []
    if len(feeding) == 1:
        notes.append(
            f"outlet {feeding[0].name} is the only one that perfuses the LV; the posterior, which tells outlets apart "
            "by their flows, needs two: a campaign would stop there"
        )
    for outlet, flow, count in zip(feeding, flows, cells, strict=True):
        velocity = flow / (math.pi * outlet.radius**2)
        if count == 0:
            notes.append(
                f"outlet {outlet.name}: its territory is empty, since no part of the wall is nearest to it; a campaign "
                "would stop there: check its position, or let it perfuse RV or septum"
            )
        elif velocity > FASTEST:
            notes.append(
                f"outlet {outlet.name}: {flow / ML_PER_MIN:.0f} mL/min through a diameter of {20 * outlet.radius:.2g} "
                f"mm is a mean velocity of {velocity:.0f} cm/s; check flow, unit and calibre"
            )
    return tuple(notes)
