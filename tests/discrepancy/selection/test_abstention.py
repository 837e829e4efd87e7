"""Abstention: held-out data, varying sizes and a flexible discrepancy speak against a hypothesis."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.inference.cross_validation import Gap
from coronaryuq.discrepancy.selection.abstention import Gaps, judge
from support.hypotheses import assume
from support.linear_problem import fit_of, here, linear_problem

ROWS, KEPT_OUT, PRIOR = 60, 80, -5.0
GAIN, SHARE = RULE.gain_beside_flexible, RULE.share_of_flexible
CONDITIONS = np.repeat(["rest", "hyperaemia", "pacing"], ROWS // 3)


def gap(nats: float) -> Gap:
    """Better than residuals of one standard deviation by so many nats per row."""
    residual = np.full(KEPT_OUT, np.sqrt(max(1.0 - 2.0 * nats, 0.0)))
    return Gap(1.0, (0.0, 2.0), {}, nats, nats * KEPT_OUT, residual)


def verdict(
    size=1.5, sizes=None, held_out=True, unexplained=False, after=0.1, flexible=0.0, both=0.1, p=0.5, error=False
):
    """Of one effect of that size, or of these under the three conditions; nats per held-out row over recalibration.

    p: of the held-out data under the effect; error: whether it is a measurement error.
    """
    effect = here("made up", is_measurement_error=error)
    random = generator(7, "test", "abstention")
    nuisance, along = random.standard_normal((ROWS, 2)), random.standard_normal(ROWS)
    felt = size if sizes is None else np.repeat(sizes, ROWS // 3)
    y = along * felt + random.standard_normal(ROWS)
    conditions = [*CONDITIONS, "half dilated"] if held_out else CONDITIONS
    data = np.append(y, 0.0) if held_out else y
    problem = linear_problem(np.zeros((len(data), 2)), {}, data, conditions, ["half dilated"] if held_out else [])
    gaps = Gaps(gap(0.0), gap(after), gap(flexible), gap(both))
    base, fit = fit_of(nuisance, y), fit_of(np.column_stack([nuisance, along]), y)
    return judge(problem, base, fit, assume(effect), [PRIOR], 20, unexplained, gaps, p)


def test_an_effect_that_passes_all_checks_is_named():
    assert not verdict().abstains and verdict().gain_beside_flexible is None


@pytest.mark.parametrize(("after", "refuted"), [(-0.1, False), (-2.0, True)])
def test_held_out_data_refute_what_they_outweigh(after, refuted):
    assert verdict(after=after).refuted == refuted == verdict(after=after).abstains


@pytest.mark.parametrize(
    ("changes", "implausible"),
    [
        ({}, True),
        ({"error": False}, False),
        ({"size": 1.5}, False),
        ({"unexplained": False}, False),
        ({"p": 0.5}, False),
    ],
)
def test_a_large_measurement_error_that_does_not_explain_everything_is_not_named(changes, implausible):
    case = {"error": True, "size": 3.3, "unexplained": True, "p": 1e-9, "both": 1.0} | changes
    assert verdict(**case).implausible == implausible == verdict(**case).abstains


@pytest.mark.parametrize(("size", "believed"), [(3.3, True), (-3.3, True), (4.7, False), (-4.7, False)])
def test_an_implausible_size_is_not_named_however_well_it_explains(size, believed):
    judged = verdict(size=size, after=5.0)
    assert judged.implausible != believed and judged.abstains != believed


@pytest.mark.parametrize("unexplained", [False, True])
def test_data_held_out_in_turn_are_counted_once(unexplained):
    """They add no evidence, but where something remains they must be predicted better."""
    assert verdict(after=-2.0, held_out=False, unexplained=unexplained).refuted == unexplained


@pytest.mark.parametrize(("both", "abstains"), [(GAIN / 2, True), (2 * GAIN, False)])
def test_varying_sizes_must_help_a_flexible_discrepancy_clearly(both, abstains):
    judged = verdict(sizes=(0.0, 1.5, 3.0), both=both)
    assert [entry.placed.place for entry in judged.varying] == ["here"]
    assert judged.abstains == abstains and judged.gain_beside_flexible == pytest.approx(both)


@pytest.mark.parametrize(("both", "abstains"), [(GAIN / 2, True), (2 * GAIN, False)])
def test_effects_that_do_not_predict_held_out_data_must_help_it_clearly(both, abstains):
    judged = verdict(p=RULE.unpredicted / 2, both=both)
    assert judged.unpredicted and judged.abstains == abstains and judged.gain_beside_flexible == pytest.approx(both)
    assert verdict(p=2 * RULE.unpredicted, both=both).gain_beside_flexible is None


@pytest.mark.parametrize(("both", "abstains"), [(1.0 + GAIN / 2, True), (1.0 + 2 * GAIN, False)])
def test_effects_that_a_flexible_discrepancy_outperforms_must_help_it_clearly(both, abstains):
    assert verdict(unexplained=True, after=0.92, flexible=1.0, both=both).abstains == abstains


@pytest.mark.parametrize(("after", "outperformed"), [(SHARE - 0.02, True), (SHARE + 0.02, False)])
@pytest.mark.parametrize("doubt", [{"unexplained": True}, {"sizes": (1.0, 4.0, 1.0)}, {"p": RULE.unpredicted / 2}])
def test_doubtful_effects_must_gain_nearly_as_much_as_a_flexible_discrepancy(after, outperformed, doubt):
    judged = verdict(after=after, flexible=1.0, both=1.0 + 2 * GAIN, **doubt)
    assert judged.outperformed == outperformed == judged.abstains
    assert not verdict(after=after, flexible=1.0, both=1.0 + 2 * GAIN).outperformed, "nothing is in doubt"


def test_where_nothing_remains_a_flexible_discrepancy_does_not_compete():
    assert verdict(unexplained=False, after=0.1, flexible=0.4, both=0.4).gain_beside_flexible is None
