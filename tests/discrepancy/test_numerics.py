"""Errors of time steps: what is alike is put right, what differs in a few shapes gets weights, the rest is held."""

from types import SimpleNamespace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference import time_step_error
from coronaryuq.discrepancy.inference.time_step_error import DRAWS, FINER, time_steps

ROWS, SERIES = 80, 2
PHASE = 2.0 * np.pi * np.arange(ROWS) / (ROWS // SERIES)


class Ringing:
    """Predictions whose coarse steps leave out a mean and a ringing of two shapes, which hangs on the parameters."""

    def __init__(self, mean, ringing, failing=False):
        self.mean, self.ringing, self.failing = mean, ringing, failing
        self.nuisances, self.size = [None] * 5, ROWS
        self.simulation = SimpleNamespace(steps_per_cycle=300, changed=lambda steps_per_cycle: steps_per_cycle)

    def split(self, values):
        return np.split(values, SERIES, axis=1)

    def missing(self, z):
        return self.mean + self.ringing * (np.outer(z[:, 0], np.sin(9 * PHASE)) + np.outer(z[:, 1], np.cos(9 * PHASE)))

    def predict(self, z):
        found = np.tile(10.0 + z[:, 2:3], ROWS)
        if self.failing:
            found[1:] = np.nan
        return found + self.missing(z) if isinstance(self.simulation, int) else found


class Drifting(Ringing):
    """The same with a ringing whose phase, and not only its size, hangs on the parameters."""

    def missing(self, z):
        return self.mean + self.ringing * np.sin(9 * PHASE + 3.0 * np.sin(PHASE) * z[:, :1] + z[:, 1:2])


@pytest.fixture(autouse=True)
def copies(monkeypatch):
    def replace(forward, simulation):
        other = type(forward)(forward.mean, forward.ringing, forward.failing)
        other.simulation = simulation
        return other

    monkeypatch.setattr(time_step_error, "replace", replace)


def test_what_is_alike_is_put_right():
    found = time_steps(Ringing(np.sin(PHASE), 0.0), np.full(ROWS, 0.5))
    assert found.change == pytest.approx(np.sin(PHASE)) and not len(found.shapes)
    assert found.sd == pytest.approx(np.linalg.norm(np.sin(PHASE[: ROWS // SERIES])) / 0.5 * 0.5 / FINER)


def test_what_differs_in_two_shapes_gets_two_weights():
    """Which explain the ringing at another point, to within what each weight's prior holds back."""
    forward, noise = Ringing(np.zeros(ROWS), 5.0), np.full(ROWS, 0.5)
    found = time_steps(forward, noise)
    assert len(found.shapes) == 2
    z = 0.5 * generator(1, "test", "numerics").standard_normal((1, 5))
    missing, shapes = (forward.missing(z)[0] - found.change) / noise, found.shapes / noise
    weights = np.linalg.solve(np.eye(2) + shapes @ shapes.T, shapes @ missing)
    left = missing - weights @ shapes
    assert np.linalg.norm(left) < 0.05 * np.linalg.norm(missing)
    assert np.linalg.norm(left) < 3.0 * (found.sd / noise).max()


def test_little_ringing_is_held_as_noise_along_any_shape():
    """The variance that the rows are given along the ringing itself is that of the ringing, to within two standard
    errors of a variance from `DRAWS` points."""
    ringing, noise = 0.02, np.ones(ROWS)
    found = time_steps(Ringing(np.zeros(ROWS), ringing), noise)
    assert not len(found.shapes)
    shape = np.sin(9 * PHASE[: ROWS // SERIES])
    along = shape / np.linalg.norm(shape)
    given = np.sum(along**2 * found.sd[: ROWS // SERIES] ** 2)
    true, error = (0.5 * ringing * np.linalg.norm(shape)) ** 2, np.sqrt(2.0 / (DRAWS - 1))
    assert 1.0 - 2.0 * error < given / true < 1.0 + 2.0 * error


def test_what_the_shapes_leave_is_held_along_any_shape_of_a_series():
    """A ringing whose phase hangs on the parameters, 22 noise sd in each series, has more shapes than weights. At fresh
    points what is left is below the noise along any shape, and at most twice as large as it is said to be: the worst
    shapes are known from the points that they were found at."""
    forward, noise, random = Drifting(np.zeros(ROWS), 5.0), np.ones(ROWS), generator(2, "test", "numerics")
    found = time_steps(forward, noise)
    fresh = 0.5 * random.standard_normal((400, 5))
    missing = forward.missing(fresh) - found.change
    shapes = found.shapes
    left = missing - missing @ shapes.T @ np.linalg.solve(np.eye(len(shapes)) + shapes @ shapes.T, shapes)
    for block, sd in zip(forward.split(left), found.sd[:: ROWS // SERIES], strict=True):
        worst = np.linalg.norm(block, ord=2) / np.sqrt(len(block))
        assert 0.5 * sd < worst < min(1.0, 2.0 * sd)


def test_where_one_point_runs_all_is_held():
    found = time_steps(Ringing(np.sin(PHASE), 0.0, failing=True), np.ones(ROWS))
    assert not found.change.any() and found.sd == pytest.approx(np.abs(np.sin(PHASE)))
