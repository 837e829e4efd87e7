"""Wall shear on meshes as a patient gets them: tubes through the project's own mesher against exact references.

What the region's mean and the rms of wall shear (share of the mean) earn, R = 0.15 cm:

- Straight tube at Re 55 to 220: within 0.6 (h/R)² and 0.8 (h/R)² of Poiseuille's.
- 60 % stenosis (diameter), Re 95 and 180 upstream, `throat_resolution`/`resolution`/`jet_resolution` 3/2/3: mean 17 to
  32 % too high; 4/2/3: 11 to 18 %; 5/3/4: 4 to 8 %; 6/3/6: 5 to 6 %. The rms is 46 to 82, 29 to 50, 16 to 30 and 11 to
  20 %, most of it at the throat, where the boundary layer is thinner than an element. Without elements that resolve the
  jet the mean is 28 to 58 % too high at 3/2. The pointwise minimum is nought where the flow separates and has no
  meaningful relative error; the 1 % quantile is off by up to a factor of ten at 5/3/4 and by 15 % at 6/3/6.
"""

from collections.abc import Sequence

import numpy as np

from coronaryuq.bench import axisymmetric, tubes
from coronaryuq.case.tree import Stenosis, Tree, Vessel
from coronaryuq.flow3d.discretisation import Discretisation
from coronaryuq.flow3d.lanes import LANES
from coronaryuq.flow3d.mesh.build import build
from coronaryuq.flow3d.mesh.settings import Settings
from coronaryuq.flow3d.observation import area_quantile
from coronaryuq.flow3d.wall_shear import WallShear
from coronaryuq.units import BLOOD_DENSITY, BLOOD_VISCOSITY

STENOSED = ((3.0, 2.0, 1.5), (3.0, 2.0, 3.0), (4.0, 2.0, 3.0), (5.0, 3.0, 4.0), (6.0, 3.0, 6.0))
"""R/h at the throat, elsewhere and in the jet."""


def meshed(points: np.ndarray, radii: np.ndarray, settings: Settings, stenoses=(), dt: float = 1e-3) -> Discretisation:
    """One vessel of centreline points (n, 3) and radii (n,), cm, meshed as a patient's are."""
    tree = Tree([Vessel("LAD", points, np.broadcast_to(radii, len(points)), None, "LAD")])
    mesh = build(tree, stenoses, settings).mesh
    caps = {name: mesh.triangles[mesh.face == number] for number, name in mesh.caps.items()}
    ends = [next(name for name in caps if name.startswith(kind)) for kind in ("inlet", "outlet")]
    return Discretisation(
        mesh.points, mesh.tets, {name: caps[name] for name in ends}, ends[:1], dt, BLOOD_DENSITY, BLOOD_VISCOSITY
    )


def straight(resolution: float, flow: np.ndarray, length: float = 1.0) -> dict[str, np.ndarray]:
    """Relative errors (LANES,) of wall shear in the middle third of a straight tube at flows (LANES,), mL/s."""
    x = np.linspace(0.0, length, 51)
    settings = Settings(domain="whole", resolution=resolution, throat_resolution=max(resolution, 2.0))
    space = meshed(np.c_[x, 0 * x, 0 * x], np.full(51, tubes.RADIUS), settings)
    stepper = tubes.steady(space, flow, time=0.4)
    exact = 4 * BLOOD_VISCOSITY * flow / (np.pi * tubes.RADIUS**3)
    found = errors(space, stepper, lambda x: np.broadcast_to(exact, (len(x), LANES)), (length / 3, 2 * length / 3))
    drop = 8 * BLOOD_VISCOSITY * length * flow / (np.pi * tubes.RADIUS**4)
    return found | {"drop": stepper.cap_pressure[0] / drop - 1.0}


def reference(flows: Sequence[float]) -> list[axisymmetric.AxisymmetricFlow]:
    """Flow through `tubes.narrowing` without a third dimension, one for each flow in mL/s."""
    levels = np.linspace(0.0, 2.4, 121)
    return [axisymmetric.solve(tubes.narrowing, levels, 12, flow, BLOOD_DENSITY, BLOOD_VISCOSITY) for flow in flows]


def stenosed(
    resolution: tuple[float, float, float], flows: Sequence[float], exact: Sequence[axisymmetric.AxisymmetricFlow]
) -> dict[str, np.ndarray]:
    """Errors (LANES,) of wall shear around `tubes.narrowing` and of its pressure drop; flows repeat over the lanes."""
    throat, elsewhere, jet = resolution
    settings = Settings(domain="whole", throat_resolution=throat, resolution=elsewhere, jet_resolution=jet)
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
    """Wall shear between two places along x against exact(x) (k, LANES): `mean` relative, `rms` over the mean's exact
    value, `min` and `q01` (1 % area quantile) relative; `nodes` of the mesh.
    """
    wall = WallShear(space)
    wall.sample(stepper, 1.0)
    x = space.points[wall.nodes, 0]
    chosen = (x > between[0]) & (x < between[1])
    area, true = wall.area[chosen], exact(x[chosen])
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
    """Errors by resolution for the benchmark: `straight` at 0.5 and 2 mL/s, `stenosis` at `flows`."""
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
            | {name: v if name == "nodes" else v[: len(flows)].tolist() for name, v in e.items()}
            for r in STENOSED
            for e in [stenosed(r, flows, exact)]
        ],
    }
