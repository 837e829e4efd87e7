"""Read what svSolver and svMultiPhysics wrote: quantities of interest of the last cycle, and the record."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from coronaryuq.case.lowest_ffr import lowest_ffr
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.vtk import read_vtk
from coronaryuq.core.records import Record
from coronaryuq.flow3d.adapter import Sample
from coronaryuq.flow3d.fem.cross_section import section_weights
from coronaryuq.flow3d.quantities import WallRegion, stenosis_quantities
from coronaryuq.flow3d.simvascular.coupled_case import CoupledCase
from coronaryuq.flow3d.simvascular.program import RunFailed


class Fields:
    """Pressure and wall shear stress of the last cycle, gathered frame by frame, and what is derived from them."""

    def __init__(self, case: CoupledCase):
        self.domain = domain = case.domain
        self.low_shear, self.places = case.low_shear, case.ffr_places
        self.distal_sections, self.proximal_sections = (
            {name: section_weights(domain.points, domain.tets, *plane, name)[:2] for name, plane in planes.items()}
            for planes in (domain.planes, domain.proximal_planes)
        )
        self.distal = dict.fromkeys(self.distal_sections, 0.0)
        self.proximal = dict.fromkeys(self.proximal_sections, 0.0)
        self.vector = np.zeros((len(domain.points), 3))
        self.magnitude = np.zeros(len(domain.points))
        self.count = 0

    def add(self, pressure: np.ndarray, shear: np.ndarray, where: str) -> None:
        """Add one frame: nodal pressure (n,) and wall shear stress vectors (n, 3), zero off the wall."""
        if not (np.isfinite(pressure).all() and np.isfinite(shear).all()):
            raise RunFailed(f"{where} contains values that are not finite: the run blew up")
        for sums, sections in ((self.distal, self.distal_sections), (self.proximal, self.proximal_sections)):
            for name, (nodes, share) in sections.items():
                sums[name] += float(share @ pressure[nodes])
        self.vector += shear
        self.magnitude += np.linalg.norm(shear, axis=1)
        self.count += 1

    def quantities(self, aortic: float, waves: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Return the quantities of interest by their names in the record.

        aortic: mean aortic pressure, dyn/cm2. waves: 0D histories of the last cycle.
        """
        tawss = (self.magnitude / self.count)[:, None]
        osi = 0.5 * (1.0 - np.linalg.norm(self.vector, axis=1) / np.maximum(self.magnitude, 1e-300))[:, None]
        quantities = {"aortic_pressure": aortic}
        for name, triangles in self.domain.regions.items():
            region = WallRegion.of(self.domain.points, triangles, np.arange(len(self.domain.points)))
            distal, shear = np.array([self.distal[name] / self.count]), (tawss[region.rows], osi[region.rows])
            proximal = np.array([self.proximal[name] / self.count]) if name in self.proximal else None
            values = stenosis_quantities(name, distal, np.array([aortic]), *shear, region, self.low_shear, proximal)
            quantities |= {key: float(value[0]) for key, value in values.items()}
        at_ends = {end: np.mean(waves[end]) / aortic for of in self.places.values() for end in of.ends}
        at_stenoses = {name: np.array(quantities[f"ffr_{name.lower()}"]) for name in self.domain.regions}
        lowest = lowest_ffr(self.places, at_ends, at_stenoses)
        return quantities | {key: float(value) for key, value in lowest.items()}


def histories(case: CoupledCase, path: Path) -> dict[str, np.ndarray]:
    """Read the 0D histories that a 3D code wrote: unknown → values at the steps of the last cycle."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError:
        raise RunFailed(f"{path.name} is missing: the 0D side never ran") from None
    names = lines[0].split()[1:] if lines else []
    try:
        table = np.array([[float(word) for word in line.split()] for line in lines[1:]])
    except ValueError:
        raise RunFailed(f"{path.name} is truncated or not numeric") from None
    # A row holds the state after a step, but the time before it.
    if table.ndim != 2 or table.shape[1] != len(names) + 1 or len(table) < case.steps:
        raise RunFailed(f"{path.name} is truncated: {len(table)} of {case.steps} steps")
    last = table[-case.settings.steps_per_cycle :, 1:]
    if not np.isfinite(last).all():
        raise RunFailed(f"{path.name} contains values that are not finite: the 0D side blew up")
    return {name: last[:, k] for k, name in enumerate(names)}


def cap_quantities(case: CoupledCase, waves: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Return mean, smallest and largest flow and mean pressure at the caps, by 0D connection."""
    out = {}
    for cap in case.coupled.caps:
        flow, pressure = waves[f"flow:{case.coupled.place[cap]}"], waves[f"pressure:{case.coupled.place[cap]}"]
        connection = case.coupled.connection[cap]
        out[f"mean_flow:{connection}"] = float(flow.mean())
        out[f"min_flow:{connection}"], out[f"max_flow:{connection}"] = float(flow.min()), float(flow.max())
        out[f"mean_pressure:{connection}"] = float(pressure.mean())
    return out


def record(
    case: CoupledCase, sample: Sample, fields: Fields, waves: Mapping[str, np.ndarray], solver: Mapping[str, str]
) -> Record:
    """Return the record of a finished run; fields and waves: of its last cycle; solver: its name and coupling."""
    return Record(
        sample.name,
        dict(sample.theta),
        fields.quantities(float(waves[case.aortic_pressure].mean()), waves) | cap_quantities(case, waves),
        solver=dict(solver),
        cost={"cycles": case.settings.cycles, "steps": case.steps},
        diagnostics={"steps_per_cycle": case.settings.steps_per_cycle, "frames": fields.count},
    )


def load(path: Path) -> Any:
    """Read a VTK file that a 3D code wrote; raise `RunFailed` if it is missing or truncated."""
    if not path.is_file():
        raise RunFailed(f"{path.name} is missing: the run ended early")
    try:
        return read_vtk(path)
    except InputError as error:
        raise RunFailed(f"{path.name}: {error.remedy}") from None


def field(data: Any, name: str, path: Path) -> np.ndarray:
    if name not in data.point_data:
        raise RunFailed(f"{path.name} has no field {name}; it has {', '.join(data.point_data) or 'none'}")
    return np.asarray(data.point_data[name], float)
