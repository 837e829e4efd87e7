"""Errors of steps and vessels where a loop oscillates after its valves close."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.benchmark import NATURE
from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import closed_loop
from coronaryuq.bench.discrepancy.trial import analyse, hide
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.inference.error_runs import ErrorRuns
from coronaryuq.discrepancy.inference.known_errors import known_errors
from coronaryuq.discrepancy.inference.read_problem import make_problem, with_time_steps
from coronaryuq.discrepancy.inference.time_step_error import FINER, oscillates, time_steps
from coronaryuq.discrepancy.inference.vessel_errors import vessel_errors
from coronaryuq.discrepancy.selection.answer import NOTHING
from coronaryuq.discrepancy.settings import Settings
from support.hypotheses import assume
from support.small_loop import loop, oscillating_loop


def model(network):
    """The experiment's model, and the standard deviations of its data, CGS."""
    experiment = closed_loop(network)
    blank = experiment.plan.blank(network, experiment.conditions, generator(1, "test", "known errors"))
    forward = make_problem(network, experiment.conditions, blank, Settings()).forward
    values = forward.split(forward.predict(np.zeros(len(forward.nuisances))))
    deviations = experiment.plan.noise_sd(forward.measured, values, 1.0)
    return forward, np.repeat(deviations, [one.value.size for one in forward.measured])


def read_through(hypothesis, forward, noise):
    """The model's own predictions with effects of one standard deviation as data, with this noise (N,)."""
    sizes = np.ones(len(hypothesis.parameters))
    values = forward.split(forward.predict(np.append(np.zeros(len(forward.nuisances)), sizes), hypothesis))
    return [
        replace(series, value=value[0], sd=noise[rows])
        for series, value, rows in zip(forward.measured, values, forward.rows, strict=True)
    ]


def of_the_oscillating_loop(hypothesis):
    """A problem whose data have these effects, the model without its known errors, and the noise of the data."""
    forward, noise = model(oscillating_loop())
    made = make_problem(forward.network, forward.conditions, read_through(hypothesis, forward, noise), Settings())
    return with_time_steps(made), forward, noise


def added(known, noise, missing):
    """What an error (N,) that is taken to be as known adds to the chi-square of the noise."""
    sd = np.hypot(noise, known.sd)
    shapes, left = known.shapes / sd, (missing - known.change) / sd
    weights = np.linalg.solve(np.eye(len(shapes)) + shapes @ shapes.T, shapes @ left)
    return float(left @ left - weights @ (shapes @ left))


def test_the_aorta_has_errors_like_any_vessel():
    forward, _ = model(loop())
    assert {"resistance of aorta", "compliance of aorta"} <= {error.name for error in vessel_errors(forward).errors}


@pytest.mark.slow
def test_shapes_hold_a_fresh_draw_of_an_oscillation_that_the_steps_do_not_resolve():
    """What steps and vessels change at new points of the prior raises the misfit by less than its noise varies."""
    forward, noise = model(oscillating_loop())
    runs, (small, its_noise) = ErrorRuns(forward), model(loop())
    assert oscillates(runs, noise) and not oscillates(ErrorRuns(small), its_noise)
    fine, vessels = runs.with_vessels.forward.refined(FINER), runs.vessels
    found = {"usual": time_steps(runs, noise), "together": known_errors(runs, noise).steps}
    random, squares = generator(2, "test", "known errors"), dict.fromkeys(found, 0.0)
    for _ in range(4):
        z, errors = random.standard_normal(len(forward.nuisances)), random.standard_normal(len(vessels.errors))
        (truth,), (usual,) = fine.predict(np.concatenate([z, errors])), forward.predict(z)
        missing = {"usual": truth - usual - errors @ vessels.changes, "together": truth - usual}
        for name, known in found.items():
            squares[name] += added(known, noise, missing[name]) / 4
    # What the error adds to the chi-square of the noise, against the standard deviation of that.
    assert squares["together"] < np.sqrt(2.0 * len(noise)) < squares["usual"]


@pytest.mark.slow
def test_the_phase_of_an_oscillation_is_not_corrected_at_a_fit_but_read_by_instruments():
    """It is unknown. A wrong one would be taken away by whatever damps it, such as a viscoelastic wall."""
    low_pass = assume(("flow_low_pass", "J0:lca1"))
    problem, _, _ = of_the_oscillating_loop(low_pass)
    plain, fit = problem.corrected(PLAIN, problem.calibrate(PLAIN))
    assert plain is problem and np.any(problem.change != 0.0)
    read, fit = problem.corrected(low_pass, problem.calibrate(low_pass, np.append(fit.z, 1.0)))
    columns, values = read.linear_part()
    assert np.linalg.norm(values - problem.linear_part()[1]) > 1.0 and np.array_equal(fit.jacobian[:, columns], values)
    again, _ = read.corrected(PLAIN, read.calibrate(PLAIN))
    assert again.change == pytest.approx(problem.change, abs=1e-9)
    assert again.forward.shapes == pytest.approx(problem.forward.shapes, abs=1e-9)


@pytest.mark.long
def test_an_effect_that_changes_the_oscillation_changes_what_steps_and_vessels_do():
    """With the errors of the model without it, a second effect had been named that removed what they left."""
    lossy = assume(("quadratic_stenosis", "lca1"))
    problem, forward, noise = of_the_oscillating_loop(lossy)
    about, _ = problem.corrected(lossy, problem.calibrate(lossy, np.append(np.zeros(problem.count), 1.0)))
    assert about.time_steps.about[0] == lossy and problem.time_steps.about[0] == PLAIN
    again, _ = about.corrected(PLAIN, about.calibrate(PLAIN))
    assert again.forward.shapes == pytest.approx(problem.forward.shapes, rel=1e-6, abs=1e-6)
    fine, random = ErrorRuns(forward).with_vessels.forward.refined(FINER), generator(3, "test", "known errors")
    sizes, found = about.time_steps.about[1], (about.time_steps, problem.time_steps)
    squares = np.zeros(2)
    for _ in range(4):
        z, errors = (random.standard_normal(len(of)) for of in (forward.nuisances, about.error_runs().vessels.errors))
        (truth,) = fine.predict(np.concatenate([z, errors, sizes]), lossy)
        (usual,) = forward.predict(np.append(z, sizes), lossy)
        squares += [added(known, noise, truth - usual) / 4 for known in found]
    assert squares[0] < 0.25 * squares[1]


@pytest.mark.long
def test_an_oscillation_is_no_missing_effect(tmp_path):
    """Errors of vessels shift it against the data; it had been named an error of a flow probe, at 0.99."""
    hide(Case((), "none", "nominal", 1), closed_loop(oscillating_loop()), tmp_path, NATURE)
    found = analyse(tmp_path)
    assert found.answer.given == NOTHING and found.answer.probabilities[NOTHING] > 0.9
