"""Normal numbers by index follow the normal distribution in every stream."""

import numpy as np
from numba import njit
from scipy import special, stats

from coronaryuq.perfusion.normals import is_certainly_above, quantile, uniform_at


@njit
def _uniforms(key, count):
    return np.array([uniform_at(key, np.uint64(i)) for i in range(count)])


@njit
def _quantiles(p):
    return np.array([quantile(x) for x in p])


def test_quantile_agrees_with_scipy():
    p = np.concatenate([np.logspace(-16, -0.31, 2000), 1 - np.logspace(-15, -0.31, 2000)])
    assert np.allclose(_quantiles(p), special.ndtri(p), rtol=2e-7, atol=1e-7)


def test_uniforms_are_uniform_and_streams_uncorrelated():
    a, b = _uniforms(np.uint64(12), 200_000), _uniforms(np.uint64(13), 200_000)
    assert stats.kstest(a, "uniform").pvalue > 1e-3
    root = np.sqrt(a.size)
    for x, y in ((a, b), (a[1:], a[:-1]), (a[14:], a[:-14])):
        assert abs(np.corrcoef(x, y)[0, 1]) < 4 / root


def test_only_numbers_above_the_bound_are_certainly_above_it():
    p = np.random.default_rng(1).uniform(size=20_000)
    z = special.ndtri(p)
    for bound in (-0.01, -0.99, -1.0, -2.5, -3.99, -6.2, -9.0, 0.3):
        certain = np.array([is_certainly_above.py_func(x, bound) for x in p])
        assert np.all(z[certain] > bound)
        assert np.any(certain) == (bound < 0)
