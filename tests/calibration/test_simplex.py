"""Many simplices share their evaluations, and none of them notices."""

import numpy as np
import pytest
from scipy.optimize import minimize

from coronaryuq.calibration.simplex import nelder_mead

LOWER, UPPER = np.array([-2.0, -1.0]), np.array([2.0, 3.0])


def rosenbrock(points):
    return (1.0 - points[:, 0]) ** 2 + 100.0 * (points[:, 1] - points[:, 0] ** 2) ** 2


def starts(count):
    return list(np.random.default_rng(1).uniform(LOWER, UPPER, (count, 2)))


def search(first, **options):
    return nelder_mead(lambda points, which: rosenbrock(points), first, LOWER, UPPER, 0.1, 400, 1e-7, **options)


def test_every_start_finds_the_minimum_of_rosenbrock():
    for found in search(starts(5)):
        assert found.point == pytest.approx([1.0, 1.0], abs=1e-4)


def test_a_start_takes_the_same_path_alone_and_in_company():
    together = search(starts(6))
    for start, found in zip(starts(6), together, strict=True):
        (alone,) = search([start])
        assert np.array_equal(alone.point, found.point)
        assert alone.evaluations == found.evaluations


def test_a_start_ends_where_scipy_ends():
    start, width = starts(1)[0], UPPER - LOWER
    first = (start - LOWER) / width
    simplex = np.vstack([first, first + 0.1 * np.diag(np.where(first < 0.5, 1.0, -1.0))])
    expected = minimize(
        lambda x: rosenbrock((LOWER + width * x)[None])[0],
        first,
        method="Nelder-Mead",
        bounds=[(0, 1)] * 2,
        options={"initial_simplex": simplex, "maxfev": 400, "xatol": 1e-7, "fatol": 1e-7, "adaptive": True},
    )
    (found,) = search([start])
    assert np.array_equal(found.point, LOWER + width * expected.x)
    assert found.evaluations == expected.nfev


def test_evaluations_arrive_in_batches():
    sizes = []

    def objective(points, which):
        sizes.append(len(points))
        assert len(set(which)) == len(which)
        return rosenbrock(points)

    searches = nelder_mead(objective, starts(4), LOWER, UPPER, 0.1, 60)
    assert sizes[:3] == [4, 4, 4]
    assert sum(sizes) == sum(search.evaluations for search in searches)


def test_the_budget_of_evaluations_holds():
    assert all(search.evaluations <= 37 for search in nelder_mead(
        lambda points, which: rosenbrock(points), starts(3), LOWER, UPPER, 0.1, 37, 0.0))  # fmt: skip


def test_a_failing_objective_raises_here_and_leaves_no_thread_waiting():
    import threading

    def objective(points, which):
        raise ArithmeticError("no periodic state")

    before = set(threading.enumerate())  # those of pools that earlier tests made
    with pytest.raises(ArithmeticError, match="no periodic state"):
        nelder_mead(objective, starts(3), LOWER, UPPER, 0.1, 60)
    assert set(threading.enumerate()) <= before
