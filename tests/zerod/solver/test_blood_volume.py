"""Blood volume is the sum over the elements' stores, and a run conserves it."""

import numpy as np

from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.solver.engine import Engine
from support.zerod_networks import closed_loop


def stored(result, engine: Engine) -> np.ndarray:
    """Volume of the loop from the storage terms of its elements, written out."""
    y = dict(zip(engine.unknowns, result.state[:, : len(engine.unknowns)].T, strict=True))
    parameters = engine.parameters
    chambers = sum(y[f"V_{name}:CLH"] for name in ("RA", "RV", "LA", "LV"))
    aorta = parameters["CLH.Cpa"] * y["pressure:CLH:J_heart_outlet"] + parameters["RCR_aorta.C"] * y["P_c:RCR_aorta"]
    vessel = parameters["aorta.C"] * (
        y["pressure:J_heart_outlet:aorta"] - parameters["aorta.R_poiseuille"] * y["flow:J_heart_outlet:aorta"]
    )
    beds = 0.0
    for name, side in (("BC_left", "left"), ("BC_right", "right")):
        arterial = y[f"pressure:{side}:{name}"] - parameters[f"{name}.Ra"] * y[f"flow:{side}:{name}"]
        beds = beds + parameters[f"{name}.Ca"] * arterial + y[f"volume_im:{name}"]
    return chambers + aorta + vessel + beds


def test_a_loop_keeps_its_blood_volume():
    network = closed_loop(stenosis=0.0)
    network["vessels"][2]["zero_d_element_values"]["C"] = 0.0
    engine = Engine(network)
    start = engine.run_cycles(cycles=1)
    later = engine.run_cycles(cycles=20, start=start.state)
    accelerated = engine.run_to_periodic(start=start.state)
    neighbour = engine.run_to_periodic({"BC_left.Ra": 2e4}, start=later.state[0], steps_per_cycle=400)
    volume = stored(start, engine)
    assert np.allclose(BloodVolume(engine.model).evaluate(start.state), volume, rtol=1e-12)
    # A closed valve passes a flow within Newton's tolerance, so the volume is not exact to the last digit.
    assert np.allclose(stored(later, engine), volume, rtol=1e-4)
    assert np.allclose(stored(accelerated, engine), volume, rtol=1e-4)
    assert neighbour.ok[0] and np.allclose(stored(neighbour, engine), volume, rtol=3e-4)


def test_a_viscous_wall_stores_what_it_takes_up():
    """The pressure that stretches the wall is that in the vessel less that lost in the wall."""
    network = closed_loop(stenosis=0.0)
    network["vessels"][0]["zero_d_element_values"]["R_wall"] = 200.0
    engine = Engine(network)
    start = engine.run_cycles(cycles=1)
    later = engine.run_cycles(cycles=20, start=start.state)
    volume = BloodVolume(engine.model)
    assert np.allclose(volume.evaluate(later.state), volume.evaluate(start.state), rtol=1e-4)
