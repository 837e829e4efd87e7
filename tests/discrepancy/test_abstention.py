"""Held-out data, sizes that differ and a flexible discrepancy that does without them take named effects back."""

from types import SimpleNamespace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference.cross_validation import Gap
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.selection.abstention import LEAST_FORETOLD, LEAST_SHARE, WORTH, Gaps, judge
from coronaryuq.discrepancy.settings import Settings
from support.hypotheses import placed
from support.linear_problem import made_up

ROWS, KEPT_OUT, PRIOR = 60, 80, -5.0
CONDITIONS = np.repeat(["rest", "hyperaemia", "pacing"], ROWS // 3)


def gap(nats: float) -> Gap:
    """So many nats per row better than residuals of one standard deviation."""
    residual = np.full(KEPT_OUT, np.sqrt(max(1.0 - 2.0 * nats, 0.0)))
    return Gap(1.0, (0.0, 2.0), {}, nats, nats * KEPT_OUT, residual)


def verdict(
    size=1.5, sizes=None, held_out=True, still=False, after=0.1, flexible=0.0, both=0.1, foretold=0.5, instrument=False
):
    """Of one effect of that size, or of these under the three conditions; nats per held-out row over recalibration."""
    acting = placed(made_up("made up", is_measurement_error=instrument), "here")
    random = generator(7, "test", "abstention")
    nuisance, along = random.standard_normal((ROWS, 2)), random.standard_normal(ROWS)
    felt = size if sizes is None else np.repeat(sizes, ROWS // 3)
    y = along * felt + random.standard_normal(ROWS)

    def fit(g):
        z = np.linalg.solve(np.eye(g.shape[1]) + g.T @ g, g.T @ y)
        return Fit(z, y - g @ z, g)

    conditions = {name: SimpleNamespace(held_out=False) for name in dict.fromkeys(CONDITIONS)}
    conditions["half dilated"] = SimpleNamespace(held_out=held_out)
    problem = SimpleNamespace(
        count=2,
        settings=Settings(),
        condition=CONDITIONS,
        train=np.ones(ROWS, bool),
        forward=SimpleNamespace(conditions=conditions),
    )
    gaps = Gaps(gap(0.0), gap(after), gap(flexible), gap(both))
    wide = np.column_stack([nuisance, along])
    return judge(problem, fit(nuisance), fit(wide), [(acting, PRIOR)], 20, still, gaps, foretold)


def test_an_effect_that_holds_is_named():
    assert not verdict().abstains and verdict().helped is None


@pytest.mark.parametrize(("after", "refuted"), [(-0.1, False), (-2.0, True)])
def test_held_out_data_take_back_what_they_outweigh(after, refuted):
    assert verdict(after=after).refuted == refuted == verdict(after=after).abstains


@pytest.mark.parametrize(
    ("given", "incredible"),
    [
        ({}, True),
        ({"instrument": False}, False),
        ({"size": 1.5}, False),
        ({"still": False}, False),
        ({"foretold": 0.5}, False),
    ],
)
def test_a_sensor_far_off_that_does_not_explain_it_all_is_not_named(given, incredible):
    said = {"instrument": True, "size": 3.3, "still": True, "foretold": 1e-9, "both": 1.0} | given
    assert verdict(**said).incredible == incredible == verdict(**said).abstains


@pytest.mark.parametrize(("size", "believed"), [(3.3, True), (-3.3, True), (4.7, False), (-4.7, False)])
def test_a_size_that_nobody_has_is_not_named_however_well_it_explains(size, believed):
    found = verdict(size=size, after=5.0)
    assert found.incredible != believed and found.abstains != believed


@pytest.mark.parametrize("still", [False, True])
def test_data_left_out_in_turn_are_counted_once(still):
    """Without held-out conditions each is left out in turn, after a fit to all of them: no evidence of its own. Where
    something remains, recalibration must not predict them better."""
    assert verdict(after=-2.0, held_out=False, still=still).refuted == still


@pytest.mark.parametrize(("both", "abstains"), [(WORTH / 2, True), (2 * WORTH, False)])
def test_sizes_that_differ_want_a_clear_help(both, abstains):
    found = verdict(sizes=(0.0, 1.5, 3.0), both=both)
    assert [one.placed.place for one in found.varying] == ["here"]
    assert found.abstains == abstains and found.helped == pytest.approx(both)


@pytest.mark.parametrize(("both", "abstains"), [(WORTH / 2, True), (2 * WORTH, False)])
def test_held_out_data_that_are_not_as_foretold_do_too(both, abstains):
    found = verdict(foretold=LEAST_FORETOLD / 2, both=both)
    assert found.unforeseen and found.abstains == abstains and found.helped == pytest.approx(both)
    assert verdict(foretold=2 * LEAST_FORETOLD, both=both).helped is None


@pytest.mark.parametrize(("both", "abstains"), [(1.0 + WORTH / 2, True), (1.0 + 2 * WORTH, False)])
def test_a_better_flexible_discrepancy_does_too(both, abstains):
    assert verdict(still=True, after=0.92, flexible=1.0, both=both).abstains == abstains


@pytest.mark.parametrize(("after", "overtaken"), [(LEAST_SHARE - 0.02, True), (LEAST_SHARE + 0.02, False)])
@pytest.mark.parametrize("doubt", [{"still": True}, {"sizes": (1.0, 4.0, 1.0)}, {"foretold": LEAST_FORETOLD / 2}])
def test_a_flexible_discrepancy_that_closes_more_of_the_gap_is_not_outdone_beside_it(after, overtaken, doubt):
    found = verdict(after=after, flexible=1.0, both=1.0 + 2 * WORTH, **doubt)
    assert found.overtaken == overtaken == found.abstains
    assert not verdict(after=after, flexible=1.0, both=1.0 + 2 * WORTH).overtaken, "nothing is in doubt"


def test_where_nothing_remains_a_flexible_discrepancy_is_no_rival():
    assert verdict(still=False, after=0.1, flexible=0.4, both=0.4).helped is None
