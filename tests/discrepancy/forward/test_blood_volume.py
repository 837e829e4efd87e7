"""The blood volume of a closed loop, which no measurement gives and every run conserves."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.forward.jobs import Job
from coronaryuq.discrepancy.forward.nuisance import BLOOD
from coronaryuq.discrepancy.inference.read_problem import make_problem, with_time_steps
from coronaryuq.discrepancy.result.repair import repaired_network
from coronaryuq.discrepancy.selection.answer import NOTHING
from coronaryuq.discrepancy.selection.search import discover
from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.svzerodsolver.program import last_cycle
from support.small_loop import fresh, loop

AORTA = "pressure:J_heart_outlet:aorta"


def at(forward, **sizes):
    """Nuisance parameters, zero but for some, named with _ for blanks."""
    return np.array([sizes.get(nuisance.name.replace(" ", "_"), 0.0) for nuisance in forward.nuisances])


def test_a_factor_on_the_blood_volume_scales_what_a_run_starts_with():
    forward = fresh().forward
    prepared = forward.simulation.prepared(PLAIN)
    (column,) = (k for k, nuisance in enumerate(forward.nuisances) if nuisance.name == BLOOD)
    factor = float(forward.nuisances[column].factor(np.array(1.5)))
    factors, scaled = forward.factors(prepared, "rest", at(forward, blood_volume=1.5)[None, :])
    job = Job(forward.point(at(forward), PLAIN), "rest", {}, factors[0], scaled)
    assert job.blood == pytest.approx(factor) and BLOOD not in job.table(prepared)
    volume, own = BloodVolume(prepared.engine.model), prepared.start["rest"][None, :]
    started = forward.simulation.own_starts(prepared, [job])
    assert volume.evaluate(started) == pytest.approx(factor * volume.evaluate(own))
    more, less = forward.predict(np.array([at(forward, blood_volume=size) for size in (1.0, -1.0)]))
    assert (more > less)[: len(forward.measured[0].value)].all()


def test_the_repaired_loop_has_the_blood_of_the_fit_in_svzerodsolver():
    """It had what the initial condition of the model gave it, with 3 % less pressure than the fit in one case."""
    forward = fresh().forward.refined(4)
    z, usual = at(forward, systemic_compliance=1.0, blood_volume=-1.5), at(forward)
    repaired = apply_condition(repaired_network(forward, PLAIN, z), forward.conditions["rest"])
    steps = forward.simulation.steps_per_cycle
    repaired["simulation_parameters"] |= {
        "number_of_cardiac_cycles": 15,
        "number_of_time_pts_per_cardiac_cycle": steps + 1,
    }
    ours, before = (forward.split(forward.predict(row))[0].mean() / forward.pressure_factor for row in (z, usual))
    assert last_cycle(repaired, [AORTA])[AORTA][:-1].mean() == pytest.approx(ours, rel=2e-3)
    assert ours < 0.9 * before


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_another_blood_volume_is_no_missing_effect(factor):
    """It had been named an offset of all pressures, or a valve."""
    model, truth = fresh(), loop()
    truth["initial_condition"] = {name: factor * value for name, value in truth["initial_condition"].items()}
    (values,) = fresh(truth).forward.refined(4).predict(np.zeros((1, model.count)))
    random, measured = generator(1, "test", "blood volume"), []
    for series, own in zip(model.forward.measured, model.forward.split(values[None, :]), strict=True):
        sd = np.full(series.value.size, 0.02 * np.abs(own).mean())
        measured.append(replace(series, value=own[0] + sd * random.standard_normal(sd.size), sd=sd))
    problem = with_time_steps(make_problem(loop(), model.forward.conditions, measured, model.settings))
    assert discover(problem, 1).answer.probabilities[NOTHING] > 0.8
