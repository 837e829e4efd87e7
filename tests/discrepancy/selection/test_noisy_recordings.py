"""Recordings whose pressures and flow have noise of their own, as every laboratory's have."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.core import units
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.data.recordings import prepare_case
from coronaryuq.discrepancy.search_case import searched
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine

BEATS = {"rest": (0.70, 1.0), "adenosine": (0.66, 0.45), "pacing": (0.50, 0.85), "dobutamine": (0.48, 0.5)}
"""Condition → period (s) and factor on the resistance of the arterioles."""
PER_SECOND, LASTS = 300, 0.015


def recorded(folder, noise_of_flow, noise_of_pressure, seed):
    """Write recordings of a vessel and a bed as the model of recordings has them; noise in mL/min and mmHg."""
    inlet = next(b["bc_values"] for b in left_coronary()["boundary_conditions"] if b["bc_type"] == "PRESSURE")
    phase = np.array(inlet["t"]) / inlet["t"][-1]

    def beats(flows, noisy):
        for name, (period, _) in BEATS.items():
            time = np.linspace(0.0, period, round(PER_SECOND * period) + 1)
            aorta = np.interp(time / period, phase, inlet["P"]) / units.MMHG
            apart = np.abs(time[:, None] - time)
            lasting = np.linalg.cholesky(np.exp(-apart / LASTS) + 1e-9 * np.eye(len(time)))
            drawn = lasting @ generator(seed, "test", "recordings", name).standard_normal((len(time), 2))
            flow = flows.get(name, 45.0 + 10.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 50)))
            flow = np.interp(time / period, np.linspace(0.0, 1.0, len(flow)), flow)
            table = {"t [s]": time, "AoP [mmHg]": aorta + noisy * noise_of_pressure * drawn[:, 0]}
            table |= {"LVP [mmHg]": 1.02 * aorta.max() * np.sin(np.pi * time / period) ** 2}
            table |= {"LAD Flow [ml/min]": flow + noisy * noise_of_flow * drawn[:, 1]}
            pd.DataFrame(table).to_csv(folder / f"A_{name}.csv", index=False)

    folder.mkdir()
    beats({}, noisy=False)
    model, _, conditions = prepare_case(folder, "A", folder / "case")
    network, flows = read_network(model), {}
    for name, condition in read_conditions(conditions).items():
        own = apply_condition(network, condition)
        bed = own.bed_values("BC_lad")
        bed |= {key: bed[key] * BEATS[name][1] for key in ("Ra1", "Ra2")}
        run = Engine(own).run_to_periodic(waveforms=["flow:AORTA:lad"], steps_per_cycle=2000)
        flows[name] = run.waveforms["flow:AORTA:lad"][0] / units.ML_PER_MIN
    beats(flows, noisy=True)
    return prepare_case(folder, "A", folder / "case")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_noise_of_the_driving_pressure_is_not_an_error_of_the_flow_probe(tmp_path, seed):
    """The slope of 0.2 mmHg of noise is flow into the compliances of the model, though not of the artery."""
    found = searched(*recorded(tmp_path / "in", 1.0, 0.2, seed), Settings(), 1)
    assert found.consistent, [(placed.effect.name, placed.place) for placed in found.hypothesis]
