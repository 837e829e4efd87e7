"""Small networks that tests are written about, in CGS units."""

import copy

import numpy as np

from coronaryuq.case.network.network import Network

MMHG = 1333.22


def vessel(number: int, name: str, inlet: str | None = None, outlet: str | None = None, kind="BloodVessel", **values):
    ends = {side: block for side, block in (("inlet", inlet), ("outlet", outlet)) if block}
    entry = {"vessel_id": number, "vessel_name": name, "zero_d_element_type": kind, "zero_d_element_values": values}
    return entry | ({"boundary_conditions": ends} if ends else {})


def boundary(name: str, kind: str, **values):
    return {"bc_name": name, "bc_type": kind, "bc_values": values}


def network(vessels, boundaries, junctions=(), steps=100, cycles=5, **simulation):
    return Network(
        simulation_parameters={
            "number_of_cardiac_cycles": cycles,
            "number_of_time_pts_per_cardiac_cycle": steps + 1,
            **simulation,
        },
        vessels=list(vessels),
        boundary_conditions=list(boundaries),
        junctions=list(junctions),
    )


def pulse(mean: float = 5.0, amplitude: float = 2.0, points: int = 41) -> dict[str, list[float]]:
    """A smooth flow waveform of period 1 s."""
    from math import cos, pi

    times = [k / (points - 1) for k in range(points)]
    return {"t": times, "Q": [mean + amplitude * cos(2 * pi * time) for time in times]}


def bifurcation(steps: int = 100) -> dict:
    """Pulsatile flow into a vessel that splits in two, each with an RCR; linear."""
    return network(
        [
            vessel(0, "trunk", inlet="INFLOW", R_poiseuille=20.0, C=1e-5, L=1.0),
            vessel(1, "left", outlet="RCR_left", R_poiseuille=50.0, C=2e-5, L=2.0),
            vessel(2, "right", outlet="RCR_right", R_poiseuille=80.0, C=1e-5, L=3.0),
        ],
        [
            boundary("INFLOW", "FLOW", **pulse()),
            boundary("RCR_left", "RCR", Rp=500.0, C=1e-4, Rd=8000.0, Pd=0.0),
            boundary("RCR_right", "RCR", Rp=700.0, C=8e-5, Rd=12000.0, Pd=0.0),
        ],
        [{"junction_name": "J0", "junction_type": "NORMAL_JUNCTION", "inlet_vessels": [0], "outlet_vessels": [1, 2]}],
        steps=steps,
    )


def grafted(stenosis: float) -> dict:
    """A stenosed artery, driven by a pressure, with a graft from the aorta beyond its side branch: a loop."""
    time = np.linspace(0.0, 0.8, 101)
    pressure = MMHG * (93.0 + 25.0 * np.sin(2.0 * np.pi * time / 0.8) + 8.0 * np.sin(4.0 * np.pi * time / 0.8))
    joints = {"J0": ([0], [1, 2]), "J1": ([1], [4, 3]), "J2": ([3, 2], [5])}
    return network(
        [
            vessel(0, "aorta", inlet="AOP", R_poiseuille=0.07, L=0.4),
            vessel(1, "proximal", R_poiseuille=240.0, L=23.0, stenosis_coefficient=stenosis),
            vessel(2, "graft", R_poiseuille=890.0, L=118.0, C=4.4e-7),
            vessel(3, "middle", R_poiseuille=800.0, L=52.0, C=6.5e-8),
            vessel(4, "side", outlet="BC_side", R_poiseuille=4000.0, L=135.0, C=3e-8),
            vessel(5, "distal", outlet="BC_distal", R_poiseuille=1430.0, L=80.0, C=7e-8),
        ],
        [
            boundary("AOP", "PRESSURE", t=time.tolist(), P=[*pressure[:-1].tolist(), float(pressure[0])]),
            boundary("BC_side", "RCR", Rp=3e4, Rd=7e4, C=2e-6, Pd=5e3),
            boundary("BC_distal", "RCR", Rp=1.5e4, Rd=3.5e4, C=2e-6, Pd=5e3),
        ],
        [
            {"junction_name": name, "junction_type": "NORMAL_JUNCTION", "inlet_vessels": first, "outlet_vessels": then}
            for name, (first, then) in joints.items()
        ],
        steps=300,
        cycles=4,
    )


_HEART = {
    **{"Tsa": 0.40742, "tpwave": 8.976868, "iml": 0.509365, "imr": 0.806369, "Vrv_u": 9.424629, "Vlv_u": 5.606007},
    **{"Kxv_ra": 0.004837, "Kxv_la": 0.008067, "Vaso_ra": 4.848742, "Vaso_la": 9.355754},
}
_PRESSURE_LIKE = {
    **{"Erv_s": 2.125279, "Elv_s": 3.125202, "Lrv_a": 0.000186865, "Rrv_a": 0.035061704, "Lra_v": 0.000217032},
    **{"Rra_v": 0.007887459, "Lla_v": 0.000351787, "Rla_v": 0.005310825, "Rlv_ao": 0.034320234, "Llv_a": 0.000110776},
    **{"Rpd": 0.098865401, "Kxp_ra": 9.22244, "Emax_ra": 0.208858, "Kxp_la": 9.194992, "Emax_la": 0.303119},
}
_COMPLIANCES = {"Cp": 1.090989, "Cpa": 0.556854}
HEART = {
    **_HEART,
    **{name: value * MMHG for name, value in _PRESSURE_LIKE.items()},
    **{name: value / MMHG for name, value in _COMPLIANCES.items()},
}
"""Heart parameters of svZeroDSolver's closed-loop cases (Menon et al. 2023), CGS."""


def closed_loop(steps: int = 200, cycles: int = 4, stenosis: float = 2000.0) -> dict:
    """Heart, aorta with windkessel, a stenosed left and a right coronary."""
    coronary = {"Ra": 9.3 * MMHG, "Ram": 15.1 * MMHG, "Rv": 33.3 * MMHG, "Ca": 5.5e-4 / MMHG, "Cim": 3.7e-3 / MMHG}
    loop = network(
        [
            vessel(0, "aorta", R_poiseuille=4.0, L=5.0, C=1e-4),
            vessel(1, "systemic", outlet="RCR_aorta", R_poiseuille=1.0),
            vessel(2, "left", outlet="BC_left", R_poiseuille=500.0, L=5.0, stenosis_coefficient=stenosis, C=1e-6),
            vessel(3, "right", outlet="BC_right", R_poiseuille=400.0, L=5.0),
        ],
        [
            boundary(
                "RCR_aorta", "ClosedLoopRCR", Rp=0.13 * MMHG, Rd=1.36 * MMHG, C=0.24 / MMHG, closed_loop_outlet=True
            ),
            boundary("BC_left", "ClosedLoopCoronaryLeft", **coronary),
            boundary("BC_right", "ClosedLoopCoronaryRight", **coronary),
        ],
        [
            {
                "junction_name": "J0",
                "junction_type": "NORMAL_JUNCTION",
                "inlet_vessels": [0],
                "outlet_vessels": [1, 2, 3],
            }
        ],
        steps=steps,
        cycles=cycles,
        steady_initial=False,
    )
    loop["closed_loop_blocks"] = [
        {
            "outlet_blocks": ["aorta"],
            "closed_loop_type": "ClosedLoopHeartAndPulmonary",
            "cardiac_cycle_period": 1.0169,
            "parameters": copy.deepcopy(HEART),
        }
    ]
    volumes = {"V_RA:CLH": 38.43, "V_RV:CLH": 96.07, "V_LA:CLH": 38.43, "V_LV:CLH": 96.07}
    loop["initial_condition"] = {**volumes, "P_pul:CLH": 8.0 * MMHG, "pressure_all": 70.0 * MMHG}
    return loop


LOOP_PARAMETERS = [
    "BC_left.Ra",
    "BC_left.Rv",
    "BC_right.Ram",
    "RCR_aorta.Rd",
    "CLH.Elv_s",
    "CLH.Tsa",
    "left.stenosis_coefficient",
]


def varied(engine, samples: int, names: list[str], seed: int = 1) -> dict[str, np.ndarray]:
    """Draw factors from 0.6 to 1.6 on some parameters of an `Engine`."""
    random = np.random.default_rng(seed)
    return {name: engine.parameters[name] * random.uniform(0.6, 1.6, samples) for name in names}


def valve(name: str, upstream: str, downstream: str, kind: str = "PiecewiseValve", **parameters):
    ends = {"upstream_block": upstream, "downstream_block": downstream}
    return {"name": name, "type": kind, "params": {**parameters, **ends}}


def chamber(name: str, kind: str, activation: dict, **values):
    return {"name": name, "type": kind, "values": values, "activation_function": activation}


def built_heart(steps: int = 200, cycles: int = 3, smooth: bool = False) -> Network:
    """A left heart and a systemic circulation in a loop, of chambers and valves as blocks of their own; mmHg and mL.

    smooth: chambers with inertances and valves that shut gradually.
    """
    inductor, kind = {"Impedance": 2e-4}, "ChamberElastanceInductor"
    atrium_active = {"type": "wrapping_cosine", "Tsa": 0.4, "tpwave": 9.0}
    ventricle_active = {"type": "two_hill", "t_shift": 0.1, "tau_1": 0.2, "tau_2": 0.35, "m1": 1.3, "m2": 20.0}
    if smooth:
        atrium = {"Emax": 0.3, "Kxp": 9.0, "Kxv": 0.008, "Vaso": 9.0, **inductor}
        chambers = [
            chamber("LA", "ChamberElastanceInductorExponential", atrium_active, **atrium),
            chamber("LV", kind, ventricle_active, Emax=2.5, Emin=0.08, Vrd=10.0, Vrs=5.0, **inductor),
        ]
        flaps = {"kind": "ValveTanh", "Rmin": 5e-3, "Rmax": 100.0, "Steepness": 1e4}
    else:
        chambers = [
            chamber("LA", "LinearElastanceChamber", atrium_active, Emax=0.2, Epass=0.15, Vrest=4.0),
            chamber("LV", "LinearElastanceChamber", ventricle_active, Emax=2.5, Epass=0.08, Vrest=5.0),
        ]
        flaps = {"kind": "PiecewiseValve", "Rmin": 7.5e-3, "Rmax": 75.0}
    loop = network(
        [
            vessel(0, "artery", kind="BloodVesselCRL", R_poiseuille=1.1, C=1.2, L=5e-3),
            vessel(1, "vein", kind="BloodVesselCRL", R_poiseuille=0.1, C=30.0, L=5e-4),
        ],
        [],
        [
            {"junction_name": name, "junction_type": "NORMAL_JUNCTION", "inlet_blocks": [into], "outlet_blocks": [out]}
            for name, into, out in (("J0", "artery", "vein"), ("J1", "vein", "LA"))
        ],
        steps=steps,
        cycles=cycles,
        cardiac_period=0.8,
        steady_initial=False,
    )
    loop["valves"] = [valve("MV", "LA", "LV", **flaps), valve("AV", "LV", "artery", **flaps)]
    loop["chambers"] = chambers
    volumes = {"Vc:LA": 60.0, "Vc:LV": 110.0}
    loop["initial_condition"] = {**volumes, "pressure:AV:artery": 110.0, "pressure:J0:vein": 13.0}
    return loop
