"""Tables of a result."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.inference.time_step_error import TimeSteps
from coronaryuq.discrepancy.result.write import _residuals
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.vessels_of import vessels_of, vessels_shown
from support.hypotheses import assume
from support.linear_problem import here, linear_problem


def test_a_place_is_mapped_to_its_vessels():
    anatomy = Anatomy(open_loop().network)
    beds = anatomy.beds
    (one, first), (other, second), *_ = beds.items()
    assert vessels_of(first, anatomy) == vessels_of(one, anatomy) == [first]
    assert vessels_of(f"{first}~{second}", anatomy) == vessels_of(f"{one}<{other}", anatomy)
    assert vessels_of("all beds", anatomy) == list(beds.values())
    assert vessels_of(f"{first}:{one}", anatomy) == vessels_of("every flow", anatomy) == []
    read = f"{first}:{one}"
    for sensor in (read, f"{read} towards {second}", f"{read} with {second}:{other}"):
        assert vessels_shown(sensor, anatomy) == [first]
    assert vessels_shown(f"{read} and {second}:{other}", anatomy) == [first, second]
    assert vessels_shown("every flow", anatomy) == []


def test_predictions_are_those_of_each_model_whatever_its_time_steps_add_to_the_noise():
    random, effect = np.random.default_rng(1), here("effect")
    design, response = random.standard_normal((20, 2)), random.standard_normal(20)
    base = linear_problem(design, {effect: response}, random.standard_normal(20))
    steps = TimeSteps(np.zeros(20), np.zeros((0, 20)), random.uniform(1.0, 3.0, 20))
    problem, hypothesis = replace(base, time_steps=steps), assume(effect)
    plain, fit = base.calibrate(PLAIN), problem.calibrate(hypothesis)
    found = SimpleNamespace(problem=problem, base_problem=base, base=plain, fit=fit, hypothesis=hypothesis, named=[])
    table = _residuals(found)
    assert table["recalibrated"].to_numpy() == pytest.approx(design @ plain.z)
    assert table["repaired"].to_numpy() == pytest.approx(np.column_stack([design, response]) @ fit.z)
