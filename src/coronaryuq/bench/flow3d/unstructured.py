"""Accuracy of wall shear on meshes made as for a patient: tubes from the project's own mesher.

Errors of the region's mean and rms of wall shear (relative to the mean), R = 0.15 cm:

- Straight tube at Re 55 to 220: mean within 0.2 (h/R)², rms within 0.8 (h/R)² of Poiseuille's. With the corners of
  flat facets on the wall, the mean would be (h/R)²/4 higher.
- 60 % stenosis (diameter), Re 45, 90 and 180 upstream. Per mesh, `throat_resolution`/`resolution`/`jet_resolution` and
  `core_resolution`/`wall_grading`: error of the pressure drop, of the mean and the rms of wall shear, in per cent.

      3/2/3 0/0    2,761 nodes   -1.4  -3.4  -2.4     11  15  34     25  43  84
      4/2/3 0/0    3,905 nodes   -2.1  -8.2  -8.7      8  11  23     17  27  53
      5/3/4 0/0    8,351 nodes   -1.3  -5.7  -7.9      5   8   3     10  14  29
      6/3/6 0/0   17,433 nodes   -0.6  -3.2  -4.7      2   4   6      7  10  19
      3/2/3 3/0.5  7,095 nodes    1.6  -1.0  -0.7      7   9  11     13  17  29
      4/2/3 3/0.5  8,014 nodes    0.4  -3.4  -4.7      4   7   9      9  12  18
      5/3/4 3/0.5 11,250 nodes   -0.2  -2.7  -4.0      3   5   7      7   8  12
      6/3/6 3/0.5 19,309 nodes   -0.1  -1.9  -2.5      2   3   5      5   7  10

  Errors of the drop have both signs, too high up to the throat and too much recovery behind it, which favours coarse
  meshes; 101 nodes more at 4/2/3 3/0.5 made it -3.1 instead of -4.7 at Re 180.
  Elements twice as long as wide at the throat and in the jet, as by default (4/2/2 3/0.5, 5,089 nodes): 0.3 -3.8 -4.8,
  mean 3 4 3, rms 6 9 17.
  The remaining error of wall shear is at the throat, where the boundary layer is thinner than an element. The pointwise
  minimum is zero where the flow separates and has no meaningful relative error; the 1 % quantile is off by up to a
  factor of five.
"""

from collections.abc import Sequence

import numpy as np

from coronaryuq.bench.flow3d import axisymmetric, tubes
from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel
from coronaryuq.core.units import BLOOD_DENSITY, BLOOD_VISCOSITY
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.fem.wall_shear import WallShear
from coronaryuq.flow3d.mesh.generation.build import build
from coronaryuq.flow3d.mesh.settings import Settings
from coronaryuq.flow3d.quantities import area_quantile

STENOSED = ((3.0, 2.0, 3.0), (4.0, 2.0, 3.0), (5.0, 3.0, 4.0), (6.0, 3.0, 6.0))
"""R/h at the throat, elsewhere and in the jet."""
FINER = (
    {"core_resolution": 0.0, "wall_grading": 0.0, "axial_stretch": 1.0},
    {"core_resolution": 3.0, "wall_grading": 0.5, "axial_stretch": 1.0},
)
"""Without and with a resolved core of the jet and thin elements at the throat's wall."""


def meshed(points: np.ndarray, radii: np.ndarray, settings: Settings, stenoses=(), dt: float = 1e-3) -> Discretisation:
    """Mesh one vessel of centreline points (n, 3) and radii (n,), cm, as for a patient."""
    tree = Tree([Vessel("LAD", points, np.broadcast_to(radii, len(points)), None, "LAD")])
    mesh = build(tree, stenoses, settings).mesh
    caps = {name: mesh.triangles[mesh.face == number] for number, name in mesh.caps.items()}
    ends = [next(name for name in caps if name.startswith(kind)) for kind in ("inlet", "outlet")]
    return Discretisation(
        mesh.points, mesh.tets, {name: caps[name] for name in ends}, ends[:1], dt, BLOOD_DENSITY, BLOOD_VISCOSITY
    )


def straight(resolution: float, flow: np.ndarray, length: float = 1.0) -> dict[str, np.ndarray]:
    """Return relative errors (LANES,) of wall shear in the middle third of a straight tube at flows (LANES,), mL/s."""
    x = np.linspace(0.0, length, 51)
    settings = Settings(domain="whole", resolution=resolution, throat_resolution=max(resolution, 2.0))
    space = meshed(np.c_[x, 0 * x, 0 * x], np.full(51, tubes.RADIUS), settings)
    stepper = tubes.steady(space, flow, time=0.4)
    exact = 4 * BLOOD_VISCOSITY * flow / (np.pi * tubes.RADIUS**3)
    found = errors(space, stepper, lambda x: np.broadcast_to(exact, (len(x), LANES)), (length / 3, 2 * length / 3))
    drop = 8 * BLOOD_VISCOSITY * length * flow / (np.pi * tubes.RADIUS**4)
    return found | {"drop": stepper.cap_pressure[0] / drop - 1.0}


def reference(flows: Sequence[float]) -> list[axisymmetric.AxisymmetricFlow]:
    """Compute axisymmetric flow through `tubes.narrowing` for each flow in mL/s."""
    levels = np.linspace(0.0, 2.4, 121)
    return [axisymmetric.solve(tubes.narrowing, levels, 12, flow, BLOOD_DENSITY, BLOOD_VISCOSITY) for flow in flows]


def stenosed(
    resolution: tuple[float, float, float],
    flows: Sequence[float],
    exact: Sequence[axisymmetric.AxisymmetricFlow],
    **others: float,
) -> dict[str, np.ndarray]:
    """Return errors (LANES,) of wall shear around `tubes.narrowing` and of its pressure drop; flows repeat over lanes.

    others: further mesh settings.
    """
    throat, elsewhere, jet = resolution
    settings = Settings(domain="whole", throat_resolution=throat, resolution=elsewhere, jet_resolution=jet, **others)
    x = np.linspace(0.0, 2.4, 241)
    space = meshed(np.c_[x, 0 * x, 0 * x], tubes.narrowing(x), settings, [Stenosis("LAD", "LAD", 0.5, 1.5)])
    stepper = tubes.steady(space, np.resize(np.asarray(flows, float), LANES), time=0.25)
    curves = [exact[k % len(exact)] for k in range(LANES)]
    found = errors(
        space, stepper, lambda x: np.stack([np.interp(x, c.z, c.wall_shear) for c in curves], axis=1), (0.5, 2.0)
    )
    drop = np.array([curve.pressure[0] - curve.pressure[-1] for curve in curves])
    return found | {"drop": stepper.cap_pressure[0] / drop - 1.0}


def errors(space: Discretisation, stepper, exact, between: tuple[float, float]) -> dict[str, np.ndarray]:
    """Return errors of wall shear between two places along x against exact(x) (k, LANES).

    `mean` relative, `rms` over the exact mean, `min` and `q01` (1 % area quantile) relative; `nodes` of the mesh.
    """
    wall = WallShear(space)
    wall.sample(stepper, 1.0)
    x = space.points[wall.nodes, 0]
    chosen = (x > between[0]) & (x < between[1])
    area, true = wall.area[chosen, 0], exact(x[chosen])
    size = np.linalg.norm(wall.stress[chosen], axis=1)
    share = area[:, None] / area.sum()
    mean = (share * true).sum(axis=0)
    return {
        "nodes": space.nodes,
        "mean": (share * size).sum(axis=0) / mean - 1.0,
        "rms": np.sqrt((share * (size - true) ** 2).sum(axis=0)) / mean,
        "min": size.min(axis=0) / true.min(axis=0) - 1.0,
        "q01": area_quantile(size, area, 0.01) / area_quantile(true, area, 0.01) - 1.0,
    }


def wall_shear(resolutions: Sequence[float] = (2.0, 3.0, 4.0), flows: Sequence[float] = (0.4, 0.8, 1.6)) -> dict:
    """Return errors by resolution for the benchmark: `straight` at 0.5 and 2 mL/s, `stenosis` at `flows`."""
    ends = np.linspace(0.5, 2.0, LANES)
    rows = [
        {"resolution": r}
        | {name: np.asarray(v)[..., [0, -1]].tolist() if name != "nodes" else v for name, v in e.items()}
        for r in resolutions
        for e in [straight(r, ends)]
    ]
    exact = reference(flows)
    return {
        "straight": rows,
        "stenosis": [
            {"resolution": list(r)}
            | others
            | {name: v if name == "nodes" else v[: len(flows)].tolist() for name, v in e.items()}
            for r in STENOSED
            for others in FINER
            for e in [stenosed(r, flows, exact, **others)]
        ],
    }
