"""Runs whose resistances follow the pressures that they lead to end where the two agree."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy import open_loop_tree
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.feedback import MOST_ROUNDS, SETTLED, Feedback
from coronaryuq.zerod.effects.library import effect
from support.hypotheses import assume

GAIN = effect("autoregulation"), "all beds"
CONDITIONS = {c.name: c for c in (Condition("rest"), Condition("hyperaemia", coronary_resistance_scale=0.5))}
LOSS = (effect("quadratic_stenosis"), "lad_proximal")


def forward():
    """Pressures at the beds of the bundled tree; flow into one of them."""
    places = [("pressure", f"{bed}:BC_{bed}") for bed in ("lad", "diagonal", "lcx")] + [("flow", "lad:BC_lad")]
    measured = [Measured(c, q, p, "mean", None, 1.0, np.ones(1), np.ones(1)) for c in CONDITIONS for q, p in places]
    problem = make_problem(open_loop_tree.left_coronary(), CONDITIONS, measured, Settings(steps_per_cycle=200))
    return problem.forward, np.zeros(problem.count)


@pytest.mark.parametrize("stenosis", [0.0, 1.5])
def test_resistances_agree_with_the_resulting_pressures(stenosis):
    """R = R_0 (P / P_0)^g with the P of the run itself, also behind a stenosis that takes half of the pressure."""
    model, nothing = forward()
    gain = 1.0
    z = np.concatenate([nothing, [stenosis, GAIN[0].parameters[0].to_standard(gain)]])
    (found,) = model.predict_rows([(z, assume(LOSS, GAIN))])
    for number, condition in enumerate(CONDITIONS):
        pressures = dict(zip(("BC_lad", "BC_diagonal", "BC_lcx"), found[4 * number : 4 * number + 3], strict=True))
        changes, network = model.condition_changes(condition, z, assume(LOSS, GAIN))
        for bed, pressure in pressures.items():
            wanted = (
                network.bed_values(bed)["Ra1"]
                * (pressure / model.pressure_factor / model.reference_pressure[bed]) ** gain
            )
            assert changes[f"{bed}.Ra1"] == pytest.approx(wanted, rel=3.0 * SETTLED), (condition, bed)
    lad, other = found[4] / model.pressure_factor, model.reference_pressure["BC_lad"]
    assert lad / other < (0.8 if stenosis == 0.0 else 0.55), "the stenosis matters"


def test_a_run_does_not_depend_on_the_others_in_its_batch():
    model, nothing = forward()
    rows = [(np.append(nothing, size), assume(GAIN)) for size in (0.5, 2.0, -1.0)]
    together = model.predict_rows(rows)
    for row, its in zip(rows, together, strict=True):
        assert np.array_equal(forward()[0].predict_rows([row])[0], its)


def test_secant_steps_find_the_fixed_point_or_report_failure():
    """Of what a run has by what its beds feel, both falling and rising; a bed that always has more has none."""
    feedback = Feedback({"a": 90.0, "b": 60.0}, [True, True, True, False])
    laws = [lambda a, b: [100.0 - 0.5 * a, 0.8 * b + 10.0], lambda a, b: [400.0 - 3.0 * a, b]]
    laws += [lambda a, b: [a + 20.0, b], lambda a, b: [1.0, 1.0]]
    left, rounds = np.arange(4), 0
    while left.size:
        resulting = np.array([laws[number](*feedback.assumed(number).values()) for number in left])
        left, rounds = feedback.unsettled(left, resulting), rounds + 1
    assert rounds == MOST_ROUNDS and feedback.failed.tolist() == [False, False, True, False]
    assert [*feedback.assumed(0).values()] == pytest.approx([100.0 / 1.5, 50.0], rel=5.0 * SETTLED)
    assert [*feedback.assumed(1).values()] == pytest.approx([100.0, 60.0], rel=5.0 * SETTLED)
    assert [*feedback.assumed(3).values()] == [90.0, 60.0]
