"""Detectability of effects: the signal that remains in the data after recalibration without them."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.inference.gauss_newton import Search, maximise
from coronaryuq.discrepancy.inference.known_errors import known_errors
from coronaryuq.discrepancy.inference.problem import Problem

Row = tuple[np.ndarray, Hypothesis]


def least_trace(
    problem: Problem, model: Forward, without: list[Row], signals: list[np.ndarray], sd: np.ndarray
) -> float:
    """Return the smallest signal (norm) of an effect in the fitted data, in noise standard deviations; 0 if none.

    The signal is the part that neither recalibration within the prior, about the true nuisance parameters, nor the
    possible errors of the time steps and of the vessels can absorb. The model without the effect is fitted in full: to
    first order, the signal of a viscosity lower by a quarter is overestimated by half, because of the curvature along
    the resistances.

    Parameters
    ----------
    problem
        Problem without shapes among its nuisance parameters.
    model
        Its model, with time steps that resolve the signals.
    without
        Truth without each effect.
    signals
        Change of the noise-free data by each effect, (N,), CGS.
    sd
        Standard deviation of the noise, (N,).

    Raises
    ------
    FloatingPointError
        If the model does not run without one of the effects.
    """
    if not signals:
        return 0.0
    shapes, sd = with_known_errors(problem, sd)
    sd = sd[problem.train]
    absorbed = shapes[:, problem.train] / sd
    count, every = problem.count, problem.count + len(absorbed)
    conditions = set(problem.condition[problem.train])

    def predicted(rows: Iterable[tuple[np.ndarray, Row]]) -> np.ndarray:
        """Return the predictions at changes (count,) of the nuisance parameters of rows without an effect."""
        moved = []
        for change, (z, hypothesis) in rows:
            nuisances = hypothesis.nuisances(z) + change
            moved.append((np.concatenate([nuisances, hypothesis.all_sizes(z)]), hypothesis))
        return model.predict_rows(moved, conditions)[:, problem.train]

    truth = predicted((np.zeros(count), row) for row in without)

    def residual(rows: list[tuple[np.ndarray, Any]]) -> np.ndarray:
        data = np.array([truth[number] + signals[number][problem.train] for _, number in rows])
        moved = predicted((change[:count], without[number]) for change, number in rows)
        return (data - moved) / sd - np.array([change[count:] @ absorbed for change, _ in rows])

    exact = list(range(count, every)), absorbed.T
    searches = [Search(number, np.zeros(every), list(range(count)), exact=exact) for number in range(len(without))]
    maximise(residual, searches, problem.settings.iterations)
    if any(search.failed for search in searches):
        raise FloatingPointError("the hidden case does not run without one of its effects")
    return float(np.sqrt(min(search.fit.objective for search in searches)))


def with_known_errors(problem: Problem, sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the shapes (k, N) of a problem's known errors, and the noise with what they leave.

    sd: of the noise alone, (N,).
    """
    known = known_errors(problem.error_runs(), sd)
    shapes = np.vstack([known.steps.shapes, known.shapes, known.parameters.changes])
    return shapes, np.sqrt(sd**2 + known.steps.sd**2 + known.sd**2)
