"""What an effect leaves of itself once the model without it is recalibrated: laws, and a case of much curvature."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.benchmark import NATURE
from coronaryuq.bench.discrepancy.hidden_cases import closed_loop, open_loop
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.hidden.detectability import least_trace
from coronaryuq.discrepancy.hidden.make_case import Noise, Signal, draw_subject, hide
from coronaryuq.discrepancy.hidden.nature import Nature
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.read_problem import make_problem, read_problem
from coronaryuq.discrepancy.inference.time_step_error import time_steps
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.network.read import read_network
from support.hypotheses import assume
from support.small_loop import oscillating_loop


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    """The open loop's problem with nothing hidden, nuisance parameters as in the model."""
    folder = tmp_path_factory.mktemp("nothing")
    hide(open_loop(), assume(), np.zeros(0), Noise(), 1, folder, nature=Nature(beds=0.0, states=0.0))
    conditions, network = read_conditions(folder / "conditions.yaml"), read_network(folder / "model.json")
    read = read_problem(network, folder / "measurements.csv", conditions, folder / "conditions.yaml", Settings())
    return make_problem(network, conditions, read.forward.measured, Settings())


def to_first_order(problem, signal):
    sd = np.hypot(problem.sd, time_steps(problem.error_runs(), problem.sd).sd)
    nothing = np.zeros(problem.count)
    (residual,) = problem.whitened([(nothing, assume())])
    jacobian = problem.sensitivity(nothing, residual, assume()) * (problem.sd / sd)[:, None]
    allowed = time_steps(problem.error_runs(), problem.sd).shapes / sd
    columns = np.hstack([jacobian, allowed.T])[problem.train]
    one = (signal / sd)[problem.train]
    fit = Fit(np.zeros(columns.shape[1]), one, columns)
    return float(np.sqrt(one @ fit.projection(one)))


def trace(problem, signal):
    return least_trace(problem, problem.forward, [(np.zeros(problem.count), assume())], [signal], problem.sd)


def test_no_effect_leaves_no_trace(problem):
    assert least_trace(problem, problem.forward, [], [], problem.sd) == 0.0
    assert trace(problem, np.zeros(len(problem.y))) == 0.0


@pytest.mark.slow
def test_a_recalibration_leaves_at_most_its_prior_cost(problem):
    """Two standard deviations of any nuisance parameter can be taken up for two."""
    rows = [(2.0 * unit, assume()) for unit in np.eye(problem.count)]
    plain = problem.forward.predict(np.zeros(problem.count))[0]
    for moved in problem.forward.predict_rows(rows):
        assert trace(problem, moved - plain) < 2.0 + 0.02


def test_a_small_change_leaves_its_first_order_trace(problem):
    random = np.random.default_rng(3)
    signal = 0.1 * problem.sd * random.standard_normal(len(problem.y))
    assert trace(problem, signal) == pytest.approx(to_first_order(problem, signal), rel=0.01)


def test_the_least_detectable_of_several_effects_counts(problem):
    offset = np.where(problem.owner == 0, 5.0 * problem.sd, 0.0)
    nothing = (np.zeros(problem.count), assume())
    both = least_trace(problem, problem.forward, [nothing, nothing], [offset, 0.1 * offset], problem.sd)
    assert both == pytest.approx(trace(problem, 0.1 * offset), rel=1e-3) and both < trace(problem, offset)


def test_a_viscosity_change_leaves_less_than_its_first_order_trace(problem):
    """All resistances by a quarter lower: recalibration follows them along their curve."""
    viscosity = assume(("haematocrit", "everywhere"))
    z = np.concatenate([np.zeros(problem.count), [-1.2]])
    signal = problem.forward.predict_rows([(z, viscosity)])[0] - problem.forward.predict(z[:-1])[0]
    found = trace(problem, signal)
    assert found < 0.8 * to_first_order(problem, signal), (found, to_first_order(problem, signal))


@pytest.mark.long
def test_a_change_of_the_time_step_error_is_no_signal():
    """Where a loop oscillates, what recalibration takes up for one standard deviation is not seen as a signal.

    The usual time steps err differently at the two points, which had counted.
    """
    subject = draw_subject(closed_loop(oscillating_loop()), NATURE, 1)
    fine, coarse = subject._model, subject.problem.forward
    assert fine.simulation.steps_per_cycle > coarse.simulation.steps_per_cycle
    truth = subject.nuisance
    moved = truth + np.eye(len(truth))[[n.name for n in coarse.nuisances].index("systemic compliance")]
    before, after = fine.predict(np.array([truth, moved]))
    signal = Signal(assume(), np.zeros(0), after, [(truth, assume())], [after - before], "own")
    seen = subject.visible(signal, Noise())
    usual = least_trace(subject.problem, coarse, signal.without, signal.changes, subject._sd(signal, Noise()))
    assert seen < 1.02 < usual
