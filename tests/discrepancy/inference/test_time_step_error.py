"""Time-step error: the common part is corrected, a few shapes get weights, the rest is covered by the noise."""

from dataclasses import dataclass

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.inference.error_runs import ErrorRuns
from coronaryuq.discrepancy.inference.time_step_error import DRAWS, FINER, time_steps
from support.series_problem import series_problem, waveform

ROWS, SERIES = 80, 2
PHASE = 2.0 * np.pi * np.arange(ROWS) / (ROWS // SERIES)
COARSE = 300


@dataclass
class Ringing(Forward):
    """Predictions whose coarse steps omit a mean and a ringing of two shapes, which depends on the parameters."""

    mean: np.ndarray | float = 0.0
    ringing: float = 0.0
    failing: bool = False

    def missing(self, z):
        return self.mean + self.ringing * (np.outer(z[:, 0], np.sin(9 * PHASE)) + np.outer(z[:, 1], np.cos(9 * PHASE)))

    def predict(self, z):
        predicted = np.tile(10.0 + z[:, 2:3], ROWS)
        if self.failing:
            predicted[1:] = np.nan
        return predicted + self.missing(z) if self.simulation.steps_per_cycle > COARSE else predicted


class Drifting(Ringing):
    """A ringing whose phase, and not only its size, depends on the parameters."""

    def missing(self, z):
        return self.mean + self.ringing * np.sin(9 * PHASE + 3.0 * np.sin(PHASE) * z[:, :1] + z[:, 1:2])


def ringing(mean, size, failing=False, kind=Ringing):
    time = np.arange(ROWS // SERIES) / (ROWS // SERIES)
    nuisances = [Nuisance(f"nuisance {number}", 1.0) for number in range(5)]
    plain = series_problem([waveform(time, 1.0) for _ in range(SERIES)], nuisances).forward
    assert plain.simulation.steps_per_cycle == COARSE
    return kind(plain.simulation, plain.measured, nuisances, 1.0, mean=mean, ringing=size, failing=failing)


def test_another_noise_takes_no_further_runs():
    """The errors are those that fresh runs give."""
    forward, asked = ringing(np.sin(PHASE), 5.0), []
    forward.predict = lambda z: asked.append(z) or Ringing.predict(forward, z)
    runs = ErrorRuns(forward)
    time_steps(runs, np.full(ROWS, 0.5))
    before = len(asked)
    found = time_steps(runs, np.full(ROWS, 0.4))
    assert len(asked) == before > 0
    fresh = time_steps(ErrorRuns(ringing(np.sin(PHASE), 5.0)), np.full(ROWS, 0.4))
    for name in ("change", "shapes", "sd"):
        np.testing.assert_array_equal(getattr(found, name), getattr(fresh, name))


def test_the_common_part_of_the_error_is_corrected():
    found = time_steps(ErrorRuns(ringing(np.sin(PHASE), 0.0)), np.full(ROWS, 0.5))
    assert found.change == pytest.approx(np.sin(PHASE)) and not len(found.shapes)
    assert found.sd == pytest.approx(np.linalg.norm(np.sin(PHASE[: ROWS // SERIES])) / 0.5 * 0.5 / FINER)


def test_an_error_of_two_shapes_gets_two_weights():
    """Which explain the ringing at another point, to within what each weight's prior holds back."""
    forward, noise = ringing(np.zeros(ROWS), 5.0), np.full(ROWS, 0.5)
    found = time_steps(ErrorRuns(forward), noise)
    assert len(found.shapes) == 2
    z = 0.5 * generator(1, "test", "numerics").standard_normal((1, 5))
    missing, shapes = (forward.missing(z)[0] - found.change) / noise, found.shapes / noise
    weights = np.linalg.solve(np.eye(2) + shapes @ shapes.T, shapes @ missing)
    left = missing - weights @ shapes
    assert np.linalg.norm(left) < 0.05 * np.linalg.norm(missing)
    assert np.linalg.norm(left) < 3.0 * (found.sd / noise).max()


def test_little_ringing_is_covered_by_noise():
    """The variance that the rows are given along the ringing itself is that of the ringing, to within two standard
    errors of a variance from `DRAWS` points."""
    size, noise = 0.02, np.ones(ROWS)
    found = time_steps(ErrorRuns(ringing(np.zeros(ROWS), size)), noise)
    assert not len(found.shapes)
    shape = np.sin(9 * PHASE[: ROWS // SERIES])
    along = shape / np.linalg.norm(shape)
    given = np.sum(along**2 * found.sd[: ROWS // SERIES] ** 2)
    true, error = (0.5 * size * np.linalg.norm(shape)) ** 2, np.sqrt(2.0 / (DRAWS - 1))
    assert 1.0 - 2.0 * error < given / true < 1.0 + 2.0 * error


def test_the_rest_of_the_error_is_covered_along_any_shape_of_a_series():
    """A ringing whose phase hangs on the parameters, 22 noise sd in each series, has more shapes than weights. At fresh
    points what is left is below the noise along any shape, and at most twice as large as it is said to be: the worst
    shapes are known from the points that they were found at."""
    forward, noise, random = (
        ringing(np.zeros(ROWS), 5.0, kind=Drifting),
        np.ones(ROWS),
        generator(2, "test", "numerics"),
    )
    found = time_steps(ErrorRuns(forward), noise)
    fresh = 0.5 * random.standard_normal((400, 5))
    missing = forward.missing(fresh) - found.change
    shapes = found.shapes
    left = missing - missing @ shapes.T @ np.linalg.solve(np.eye(len(shapes)) + shapes @ shapes.T, shapes)
    for block, sd in zip(forward.split(left), found.sd[:: ROWS // SERIES], strict=True):
        worst = np.linalg.norm(block, ord=2) / np.sqrt(len(block))
        assert 0.5 * sd < worst < min(1.0, 2.0 * sd)


def test_the_whole_error_is_covered_where_only_one_point_runs():
    found = time_steps(ErrorRuns(ringing(np.sin(PHASE), 0.0, failing=True)), np.ones(ROWS))
    assert not found.change.any() and found.sd == pytest.approx(np.abs(np.sin(PHASE)))
