"""A small pulsating network with one vessel in three dimensions: source, vessel A, the tube B, vessel C, Windkessel."""

from dataclasses import replace

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel
from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.lumen.law import lumen_law
from coronaryuq.case.lumen.profiles import with_lumen
from coronaryuq.case.network.build import Physics, Segment, elements
from coronaryuq.case.network.network import Network
from coronaryuq.core.units import BLOOD_DENSITY as DENSITY
from coronaryuq.core.units import BLOOD_VISCOSITY as VISCOSITY
from coronaryuq.flow3d.adapter import FlowModel
from coronaryuq.flow3d.ensemble.ensemble import Ensemble
from coronaryuq.flow3d.mesh.description import Couples, Face, MeshDescription
from coronaryuq.flow3d.mesh.read_mesh import Domain
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.verification.tube import tube

RADIUS, LENGTH, PERIOD = 0.15, 0.8, 0.5
RESISTANCE = 8 * VISCOSITY * LENGTH / (np.pi * RADIUS**4)
INERTANCE = DENSITY * LENGTH / (np.pi * RADIUS**2)


def network(mean=1.5, swing=0.6) -> Network:
    times = np.linspace(0, PERIOD, 51)
    flow = mean + swing * np.sin(2 * np.pi * times / PERIOD)

    def vessel(number, name, resistance, inertance, **ends):
        values = {"R_poiseuille": resistance, "L": inertance, "C": 0.0, "stenosis_coefficient": 0.0}
        return {
            "vessel_id": number,
            "vessel_name": name,
            "zero_d_element_type": "BloodVessel",
            "zero_d_element_values": values,
            "boundary_conditions": ends,
        }

    def junction(number, upstream, downstream):
        ends = {"inlet_vessels": [upstream], "outlet_vessels": [downstream]}
        return {"junction_name": f"J{number}", "junction_type": "NORMAL_JUNCTION", **ends}

    windkessel = {"Rp": 2000.0, "C": 1e-5, "Rd": 30000.0, "Pd": 0.0}
    return Network(
        {
            "simulation_parameters": {
                "number_of_cardiac_cycles": 3,
                "number_of_time_pts_per_cardiac_cycle": 201,
                "steady_initial": False,
            },
            "boundary_conditions": [
                {"bc_name": "IN", "bc_type": "FLOW", "bc_values": {"t": times.tolist(), "Q": flow.tolist()}},
                {"bc_name": "OUT", "bc_type": "RCR", "bc_values": windkessel},
            ],
            "vessels": [
                vessel(0, "A", 10.0, 0.0, inlet="IN"),
                vessel(1, "B", RESISTANCE, INERTANCE),
                vessel(2, "C", 10.0, 0.0, outlet="OUT"),
            ],
            "junctions": [junction(0, 0, 1), junction(1, 1, 2)],
        }
    )


def domain(rings=3, radius=RADIUS) -> Domain:
    points, tets, faces = tube(LENGTH, radius, rings, 5 * rings)
    wall = faces["wall"]
    height = points[wall][:, :, 2].mean(axis=1)
    region = wall[(height > 0.2) & (height < 0.6)]

    def cap(name, upstream, downstream, flow):
        return Face(name=name, kind="cap", couples=Couples(upstream=upstream, downstream=downstream, flow=flow))

    description = MeshDescription(
        faces=[cap("inlet", "J0", "B", "in"), cap("outlet", "B", "J1", "out")], replaces=["B"], regions={}, planes={}
    )
    caps = {name: faces[name] for name in ("inlet", "outlet")}
    plane = (np.array([0.0, 0.0, 0.6]), np.array([0.0, 0.0, 1.0]))
    return Domain(points, tets, caps, ["inlet"], {"LAD": region}, {"LAD": plane}, description)


def uncertain(error: LumenError, rings: int = 3, constant: bool = True) -> FlowModel:
    """The loop with an uncertain radius of the tube B; without `constant`, the tube has a stenosis in its middle."""
    z = np.linspace(0.0, LENGTH, 81)
    narrow = 0.0 if constant else 0.4 * np.exp(-(((z - 0.4) / 0.08) ** 2))
    radii = RADIUS * (np.ones(len(z)) - narrow)
    tree = Tree([Vessel("B", z[:, None] * [0.0, 0.0, 1.0], radii, None, "LAD")])
    stenoses = [] if constant else [Stenosis("LAD", "B", 0.2, 0.6)]
    loop = network()
    loop.vessel_values("B").update({k: v for k, v in elements(tree["B"], Physics()).items() if k != "C"})
    segments = [Segment("B", "B", 0.0, LENGTH, "LAD" if stenoses else None)]
    held = with_lumen(loop, tree, segments, lumen_law(tree, stenoses, error))
    shape = domain(rings, lambda at: np.interp(at, z, radii))
    pieces = [{"B": (0.0, LENGTH)}]
    shape = replace(shape, description=shape.description.model_copy(update={"pieces": pieces}))
    return FlowModel(shape, held, "A:J0", DENSITY, VISCOSITY, tree=tree)


def ensemble(settings=None, shape=None, loop=None) -> Ensemble:
    settings = settings or Settings(steps_per_cycle=200, max_cycles=4, wall_samples_per_cycle=50)
    return Ensemble(FlowModel(shape or domain(), loop or network(), "A:J0", DENSITY, VISCOSITY), settings)
