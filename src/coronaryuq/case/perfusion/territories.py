"""A ventricle made of measured territories, one cell per LV-perfusing outlet, for cases without a perfusion map."""

from collections.abc import Mapping, Sequence

import numpy as np

from coronaryuq.case.case_json import CaseOutlet
from coronaryuq.case.perfusion.perfusion_map import Wall

TYPICAL_FLOW = 2.0 / 60.0
"""mL/s/g under hyperaemia; used only if no territory volume is given."""


def wall_of_territories(
    outlets: Sequence[CaseOutlet],
    flows: dict[str, tuple[float, float]],
    tissue_density: float,
    shares: Mapping[str, float],
) -> Wall:
    """Return a wall of one vertex cell per LV-perfusing outlet, with its measured volume (cm3) and flow per mass.

    flows: outlet → (flow mL/s, volume cm3 or NaN). Each cell lies at its outlet, so that its nearest outlet is its own
    and integrating over territories returns the measured flows. shares: outlet → share of the volume by Murray's law,
    for volumes that are not given; in proportion to flow, every territory would be as well perfused as any other.
    """
    import pyvista as pv

    feeding = [outlet for outlet in outlets if outlet.perfuses == "LV"]
    notes = ["no perfusion map: measured territory flows, one cell per outlet"]
    flow = np.array([flows[outlet.name][0] for outlet in feeding])
    volume = np.array([flows[outlet.name][1] for outlet in feeding])
    unknown = ~np.isfinite(volume)
    if unknown.any():
        share = np.array([shares[outlet.name] for outlet in feeding])[unknown]
        volume[unknown] = share / share.sum() * flow[unknown].sum() / (TYPICAL_FLOW * tissue_density)
        notes.append("territory volumes are not given; assumed 2 mL/min/g in all, divided by Murray's law")
    points = np.array([outlet.point for outlet in feeding], dtype=float)
    cells = np.arange(len(points))[:, None]
    grid = pv.UnstructuredGrid({pv.CellType.VERTEX: cells}, points)
    grid.cell_data["Volume"] = volume
    grid.cell_data["MBF"] = flow / (volume * tissue_density)
    return Wall(grid, tuple(notes))
