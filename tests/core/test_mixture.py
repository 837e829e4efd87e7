"""Moments of a mixture, against those of its draws and of a part that is certain."""

import numpy as np
import pytest

from coronaryuq.core.mixture import mixture_moments


def test_moments_are_those_of_draws():
    random, weights, means = np.random.default_rng(1), np.array([0.3, 0.7]), np.array([[0.0, 1.0], [3.0, -1.0]])
    roots = random.standard_normal((2, 2, 2))
    mean, covariance = mixture_moments(weights, means, roots @ roots.transpose(0, 2, 1))
    n = 400_000
    which = (random.random(n) > weights[0]).astype(int)
    draws = means[which] + np.einsum("nij,nj->ni", roots[which], random.standard_normal((n, 2)))
    off = draws - mean
    assert mean == pytest.approx(draws.mean(axis=0), abs=4.0 * float(draws.std(axis=0).max()) / np.sqrt(n))
    products = np.einsum("ni,nj->nij", off, off)
    assert covariance == pytest.approx(products.mean(axis=0), abs=4.0 * float(products.std(axis=0).max()) / np.sqrt(n))


def test_one_component_is_itself():
    mean, covariance = mixture_moments(np.array([0.0, 1.0]), np.array([[5.0], [2.0]]), np.array([[[9.0]], [[4.0]]]))
    assert mean.tolist() == [2.0] and covariance.tolist() == [[4.0]]
