"""What rivals see of a case."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.bench.discrepancy.rivals.adapter import LEAST_ALIKE, Dictionary
from coronaryuq.discrepancy.forward.hypothesis import PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.selection.candidates import Candidate
from coronaryuq.zerod.effects.library import effect


def random_fit(random, rows=30, parameters=4):
    jacobian = 3.0 * random.standard_normal((rows, parameters))
    return Fit(random.standard_normal(parameters), random.standard_normal(rows), jacobian)


def candidate(place, response, z_score):
    return Candidate(PlacedEffect(effect("flow_gain"), place), 0.0, z_score=z_score, response=response)


@given(st.integers(0, 2**32 - 1))
def test_the_root_twice_is_the_projection_and_whitens_the_score(seed):
    random = np.random.default_rng(seed)
    fit = random_fit(random)
    dictionary, vector = Dictionary(fit, []), random.standard_normal(30)
    assert dictionary.root(dictionary.root(vector)) == pytest.approx(fit.projection(vector), rel=1e-9, abs=1e-12)
    assert dictionary.data @ dictionary.root(vector) == pytest.approx(vector @ fit.score, rel=1e-9, abs=1e-9)


def test_a_column_along_the_data_is_the_score_test():
    random = np.random.default_rng(1)
    fit, response = random_fit(random), random.standard_normal(30)
    z = response @ fit.score / np.sqrt(response @ fit.projection(response))
    dictionary = Dictionary(fit, [candidate("a", response, abs(z)), candidate("unseen", response, 0.0)])
    assert [c.place for c in dictionary.candidates] == ["a"], "candidates that the data cannot show are left out"
    assert dictionary.columns[:, 0] @ dictionary.data == pytest.approx(z)


def test_lookalikes_are_those_with_nearly_parallel_responses_of_either_sign():
    random = np.random.default_rng(2)
    fit = Fit(np.zeros(0), random.standard_normal(30), np.zeros((30, 0)))
    first, other = np.linalg.qr(random.standard_normal((30, 2)))[0].T
    angle = np.arccos(np.sqrt(LEAST_ALIKE))

    def turned(by):
        return np.cos(by) * first + np.sin(by) * other

    given_ones = [("own", turned(0.0)), ("far", turned(1.05 * angle)), ("near", -turned(0.95 * angle))]
    found = Dictionary(fit, [candidate(place, response, 5.0) for place, response in given_ones]).lookalikes(0)
    assert [c.place for c in found] == ["own", "near"]
