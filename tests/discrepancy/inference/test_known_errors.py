"""Errors of steps and vessels where a loop oscillates after its valves close."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.benchmark import NATURE
from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import closed_loop
from coronaryuq.bench.discrepancy.trial import analyse, hide
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference.error_runs import ErrorRuns
from coronaryuq.discrepancy.inference.known_errors import known_errors, oscillates, with_vessels
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.inference.time_step_error import FINER
from coronaryuq.discrepancy.inference.vessel_errors import vessel_errors
from coronaryuq.discrepancy.selection.answer import NOTHING
from coronaryuq.discrepancy.settings import Settings
from support.small_loop import loop, oscillating_loop


def model(network):
    """The experiment's model, and the standard deviations of its data, CGS."""
    experiment = closed_loop(network)
    blank = experiment.plan.blank(network, experiment.conditions, generator(1, "test", "known errors"))
    forward = make_problem(network, experiment.conditions, blank, Settings()).forward
    values = forward.split(forward.predict(np.zeros(len(forward.nuisances))))
    deviations = experiment.plan.noise_sd(forward.measured, values, 1.0)
    return forward, np.repeat(deviations, [one.value.size for one in forward.measured])


def test_the_aorta_has_errors_like_any_vessel():
    forward, _ = model(loop())
    assert {"resistance of aorta", "compliance of aorta"} <= {error.name for error in vessel_errors(forward).errors}


@pytest.mark.slow
def test_vessels_as_parameters_hold_an_oscillation_that_the_steps_do_not_resolve():
    """What the model lacks at new points of the prior raises the misfit by less than its noise varies."""
    forward, noise = model(oscillating_loop())
    linear, (small, its_noise) = ErrorRuns(forward), model(loop())
    assert oscillates(linear, noise) and not oscillates(ErrorRuns(small), its_noise)
    both = {"linear": linear, "parameters": with_vessels(linear, noise)}
    large = len(both["parameters"].forward.nuisances) - len(forward.nuisances)
    assert large > 0
    vessels = [*both["parameters"].forward.nuisances[-large:], *both["parameters"].vessels.errors]
    fine = forward.with_nuisances([*forward.nuisances, *vessels]).refined(FINER)
    known = {name: known_errors(runs, noise) for name, runs in both.items()}
    random, squares = generator(2, "test", "known errors"), dict.fromkeys(both, 0.0)
    for _ in range(4):
        z, errors = random.standard_normal(len(forward.nuisances)), random.standard_normal(len(vessels))
        sizes = dict(zip([vessel.name for vessel in vessels], errors, strict=True))
        (truth,) = fine.predict(np.concatenate([z, errors]))
        for name, runs in both.items():
            (predicted,) = runs.forward.predict(np.concatenate([z, errors[:large]])[: len(runs.forward.nuisances)])
            predicted = predicted + [sizes[error.name] for error in runs.vessels.errors] @ runs.vessels.changes
            steps = known[name].steps
            sd = np.hypot(noise, steps.sd)
            shapes, left = steps.shapes / sd, (truth - predicted - steps.change) / sd
            weights = np.linalg.solve(np.eye(len(shapes)) + shapes @ shapes.T, shapes @ left)
            squares[name] += float(left @ left - weights @ (shapes @ left)) / 4
    # What the error adds to the chi-square of the noise, against the standard deviation of that.
    assert squares["parameters"] < np.sqrt(2.0 * len(noise)) < squares["linear"]


@pytest.mark.slow
def test_an_oscillation_is_no_missing_effect(tmp_path):
    """Errors of vessels shift it against the data; it had been named an error of a flow probe, at 0.99."""
    hide(Case((), "none", "nominal", 1), closed_loop(oscillating_loop()), tmp_path, NATURE)
    found = analyse(tmp_path)
    assert found.answer.given == NOTHING and found.answer.probabilities[NOTHING] > 0.9
