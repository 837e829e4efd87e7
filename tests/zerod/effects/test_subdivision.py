"""A vessel of several parts: waves travel along it, as the equations of a transmission line say."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState
from coronaryuq.zerod.effects.library import SEARCHED
from coronaryuq.zerod.effects.subdivision import PARTS, Subdivision
from coronaryuq.zerod.solver.engine import Engine
from support.zerod_networks import network

ONE, STATE = Subdivision(), ConditionState(1.0, 0.8, {}, {}, {})
PERIOD, STEPS = 0.8, 800
TIME = np.linspace(0.0, PERIOD, STEPS + 1)
R, L, C, LOAD = 40.0, 8.0, 4e-5, 900.0
"""A vessel with a transit time of 18 ms and a characteristic impedance of 447, which its load does not match."""


def tube(harmonic: int) -> Network:
    """A vessel into which a harmonic of the beat flows, and a load."""
    flow = 10.0 + 5.0 * np.cos(2.0 * np.pi * harmonic * TIME / PERIOD)
    vessel = {
        "vessel_id": 0,
        "vessel_name": "tube",
        "boundary_conditions": {"inlet": "IN", "outlet": "OUT"},
        "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": {"R_poiseuille": R, "L": L, "C": C, "stenosis_coefficient": 0.0},
    }
    ends = [
        {"bc_name": "IN", "bc_type": "FLOW", "bc_values": {"t": TIME.tolist(), "Q": flow.tolist()}},
        {"bc_name": "OUT", "bc_type": "RESISTANCE", "bc_values": {"R": LOAD, "Pd": 0.0}},
    ]
    return network([vessel], ends, steps=STEPS)


def run(model: Network, share: float, names: list[str]) -> dict[str, np.ndarray]:
    """Waveforms of the model with all its vessels divided, as far as the share says."""
    anatomy, renamed = Anatomy(model), {}
    divided, changes = model, {}
    for place in ONE.places(anatomy):
        renamed |= ONE.aliases(place, Anatomy(divided))
        divided = ONE.insert(divided, place, anatomy)
    for place in ONE.places(anatomy):
        changes |= ONE.changes(divided, place, {"share": np.array([share])}, anatomy, STATE)
    new = [
        ":".join([name.split(":")[0], renamed.get(name.partition(":")[2], name.partition(":")[2])]) for name in names
    ]
    found = Engine(divided).run_to_periodic(changes, waveforms=new)
    assert found.ok.all()
    return {name: found.waveforms[other][0] for name, other in zip(names, new, strict=True)}


def impedance(harmonic: int) -> complex:
    """Input impedance of the line that ends in the load."""
    omega = 2.0 * np.pi * harmonic / PERIOD
    series, shunt = R + 1j * omega * L, 1j * omega * C
    own, along = np.sqrt(series / shunt), np.tanh(np.sqrt(series * shunt))
    return own * (LOAD + own * along) / (own + LOAD * along)


@pytest.mark.parametrize("harmonic", [1, 4, 8])
def test_a_divided_vessel_is_nearer_to_the_line_by_the_number_of_its_parts(harmonic):
    """Of eight parts about an eighth of the error of the lumped vessel is left."""
    errors = []
    for share in (0.0, 1.0):
        pressure = run(tube(harmonic), share, ["pressure:IN:tube"])["pressure:IN:tube"][:-1]
        amplitude = 2.0 * np.fft.rfft(pressure)[harmonic] / STEPS
        errors.append(abs(amplitude / 5.0 / impedance(harmonic) - 1.0))
    assert errors[1] < 0.2 * errors[0]


def test_parts_without_a_share_change_nothing_and_equal_parts_no_mean():
    model = left_coronary()
    names = ["pressure:lad:BC_lad", "flow:lad:BC_lad", "flow:AORTA:left_main", "pressure:lcx:BC_lcx"]
    plain = Engine(model).run_to_periodic(waveforms=names)
    lumped, divided = run(model, 0.0, names), run(model, 1.0, names)
    for name in names:
        assert lumped[name] == pytest.approx(plain.waveforms[name][0], rel=1e-6)
        mean = plain.waveforms[name][0][:-1].mean()
        # Of the quadratic losses, which are divided, too, the mean depends on the pulsation.
        assert divided[name][:-1].mean() == pytest.approx(mean, rel=1e-3)


def test_all_parts_are_equal():
    model = left_coronary()
    divided = ONE.insert(model, "lad", Anatomy(model))
    changes = ONE.changes(divided, "lad", {"share": 1.0}, Anatomy(model), STATE)
    values = model.vessel("lad")["zero_d_element_values"]
    for name in ("R_poiseuille", "L", "C"):
        parts = [float(value) for key, value in changes.items() if key.endswith(f".{name}")]
        assert parts == pytest.approx([values[name] / PARTS] * PARTS)


def test_it_is_not_in_the_library():
    assert not any(isinstance(one, Subdivision) for one in SEARCHED)
