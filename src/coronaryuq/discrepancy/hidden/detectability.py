"""What effects leave in the data once the model without them is recalibrated."""

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.gauss_newton import Search, maximise
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.time_step_error import time_steps

Row = tuple[np.ndarray, Hypothesis]


def least_trace(problem: Problem, without: list[Row], signals: list[np.ndarray], sd: np.ndarray) -> float:
    """Least norm, in noise sd, of what the fitted data keep of an effect that neither recalibration within the prior,
    about the true nuisance parameters, nor what the analyst's time steps may put wrong can take up; nought of nothing.

    problem: without shapes among its nuisance parameters; without: the truth without each effect, as rows
    (z, hypothesis); signals: what each effect adds to its row, all the data without noise (N,), CGS;
    sd: of the noise (N,).

    The model without the effect is fitted in full: to first order, viscosity a quarter lower seems to leave half as
    much again as it does, as some of that is the curvature along the resistances themselves.
    """
    if not signals:
        return 0.0
    steps = time_steps(problem.forward, sd)
    sd = np.hypot(sd, steps.sd)[problem.train]
    allowed = steps.shapes[:, problem.train] / sd
    count, every = problem.count, problem.count + len(allowed)
    conditions = set(problem.condition[problem.train])

    def predicted(rows: list[Row]) -> np.ndarray:
        return problem.forward.predict_rows(rows, conditions)[:, problem.train]

    truth = predicted(without)

    def left(rows: list[tuple[np.ndarray, int]]) -> np.ndarray:
        moved = []
        for change, number in rows:
            z, hypothesis = without[number]
            moved.append(
                (np.concatenate([hypothesis.nuisances(z) + change[:count], hypothesis.all_sizes(z)]), hypothesis)
            )
        wanted = np.array([truth[number] + signals[number][problem.train] for _, number in rows])
        return (wanted - predicted(moved)) / sd - np.array([change[count:] @ allowed for change, _ in rows])

    exact = list(range(count, every)), allowed.T
    searches = [Search(number, np.zeros(every), list(range(count)), exact=exact) for number in range(len(without))]
    maximise(left, searches, problem.settings.iterations)
    if any(search.failed for search in searches):
        raise FloatingPointError("the hidden case does not run without one of its effects")
    return float(np.sqrt(min(search.fit.objective for search in searches)))
