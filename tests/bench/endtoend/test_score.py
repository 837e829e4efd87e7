"""Scores of stated intervals and probabilities, against values by hand."""

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from coronaryuq.bench.endtoend.score import PIT_BINS, brier, intervals, pit, reliability, summary, verdict, zone, zones
from coronaryuq.core.seeds import generator

SHARES = ("0.025", "0.05", "0.25", "0.50", "0.75", "0.95", "0.975")


def normal(mean: float, sd: float) -> dict[str, float]:
    return {share: mean + sd * float(ndtri(float(share))) for share in SHARES}


def answer(truth: float, below: float = 0.5, mean: float = 0.8, sd: float = 0.05) -> dict:
    return {"truth": truth, "below": below, "quantiles": normal(mean, sd)}


def test_coverage_counts_the_truths_within_each_interval():
    # Half widths of 50, 90 and 95 %, in standard deviations: 0.674, 1.645, 1.960.
    off = [0.0, 0.5, -1.0, 1.5, 1.8, -1.9, 2.5, -3.0]
    found = intervals([answer(0.8 + 0.05 * z) for z in off])
    assert found["vessels"] == 8
    assert (found["coverage_50"], found["coverage_90"], found["coverage_95"]) == (2 / 8, 4 / 8, 6 / 8)
    assert found["low_90"] == pytest.approx(0.2152, abs=1e-4) and found["high_90"] == pytest.approx(0.7848, abs=1e-4)
    assert found["mean_width_90"] == pytest.approx(2 * 1.6448536 * 0.05)
    assert found["bias"] == pytest.approx(-0.05 * np.mean(off))
    assert sum(found["pit"]) == 8 and len(found["pit"]) == PIT_BINS


def test_both_ends_belong_to_an_interval():
    quantiles = dict(zip(SHARES, (0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9), strict=True))
    found = intervals([{"truth": end, "quantiles": quantiles} for end in (0.3, 0.7)])
    assert found["coverage_50"] == 1.0


@pytest.mark.parametrize("z", [-4.0, -1.8, -0.3, 0.0, 0.9, 1.7, 5.0])
def test_the_pit_of_a_normal_distribution_is_its_distribution_function(z):
    assert pit(0.8 + 0.05 * z, normal(0.8, 0.05)) == pytest.approx(float(ndtr(z)), rel=1e-9)


def test_the_pit_at_a_stated_quantile_is_its_share():
    quantiles = dict(zip(SHARES, (0.1, 0.2, 0.3, 0.5, 0.71, 0.8, 0.99), strict=True))
    for share, value in quantiles.items():
        assert pit(value, quantiles) == pytest.approx(float(share))


def test_the_pit_of_quantiles_that_coincide_or_cross_is_defined():
    point = dict.fromkeys(SHARES, 0.7)
    assert (pit(0.6, point), pit(0.7, point), pit(0.8, point)) == (0.0, 0.5, 1.0)
    crossing = normal(0.8, 0.05) | {"0.975": 0.87}
    assert 0.95 <= pit(0.9, crossing) <= 1.0


def test_calibrated_statements_have_even_pits_and_the_stated_coverage():
    trials = 2000
    truths = 0.8 + 0.05 * generator(1, "tests", "endtoend", "pit").standard_normal(trials)
    found = intervals([answer(float(truth)) for truth in truths])
    for level in (50, 90, 95):
        p = level / 100
        assert abs(found[f"coverage_{level}"] - p) < 4 * np.sqrt(p * (1 - p) / trials)
    expected = trials / PIT_BINS
    chi2 = sum((count - expected) ** 2 / expected for count in found["pit"])
    assert chi2 < 9 + 4 * np.sqrt(2 * 9)


def test_brier_is_the_mean_square_of_stated_less_true():
    # Significant at 0.80 itself, not above: (0.9 - 1)² + (0.6 - 1)² + (0.2 - 0)² over three.
    assert brier([answer(0.7, 0.9), answer(0.80, 0.6), answer(0.81, 0.2)]) == pytest.approx(0.21 / 3)
    assert brier([]) is None


def test_reliability_has_a_row_per_bin_with_vessels():
    rows = reliability([answer(0.7, 0.95), answer(0.9, 1.0), answer(0.9, 0.0), answer(0.9, 0.1), answer(0.7, 0.2)])
    assert [(row["bin_low"], row["bin_high"], row["vessels"], row["observed"]) for row in rows] == [
        (0.0, 0.1, 2, 0.0), (0.1, 0.3, 1, 1.0), (0.9, 1.0, 2, 0.5)
    ]  # fmt: skip
    assert [row["stated"] for row in rows] == pytest.approx([0.05, 0.2, 0.975])


def test_zones_and_verdicts_at_their_limits():
    assert [zone(ffr) for ffr in (0.749, 0.75, 0.80, 0.85, 0.851)] == [
        "below 0.75", *3 * ["0.75 to 0.85"], "above 0.85",
    ]  # fmt: skip
    assert verdict(answer(0.80, 0.9)) == "right" and verdict(answer(0.81, 0.9)) == "wrong"
    assert verdict(answer(0.81, 0.1)) == "right" and verdict(answer(0.80, 0.1)) == "wrong"
    assert verdict(answer(0.80, 0.11)) == verdict(answer(0.80, 0.89)) == "undecided"
    rows = zones([answer(0.7, 0.95), answer(0.7, 0.05), answer(0.78, 0.5), answer(0.9, 0.01)])
    assert rows == [
        {"zone": "below 0.75", "vessels": 2, "right": 1, "undecided": 0, "wrong": 1},
        {"zone": "0.75 to 0.85", "vessels": 1, "right": 0, "undecided": 1, "wrong": 0},
        {"zone": "above 0.85", "vessels": 1, "right": 1, "undecided": 0, "wrong": 0},
    ]


def test_a_summary_counts_failed_patients_apart_and_takes_none_without_a_stenosis_for_a_vessel():
    done = {"failed": None, "rhat_max": 1.2, "converged": False, "cpu_s": 100.0}
    lines = [
        {**done, "vessels": {"LAD": {"tawss_mean": answer(1.0), "ffr": answer(0.7, 0.9)}}},
        {**done, "vessels": {}, "rhat_max": None, "converged": None, "cpu_s": 0.0},
        {**done, "vessels": {}, "failed": "truth: no mesh"},
    ]
    found = summary(lines)
    assert (found["patients"], found["failed"], found["vessels"], found["converged"]) == (2, 1, 1, 0)
    assert [row["quantity"] for row in found["quantities"]] == ["ffr", "tawss_mean"]
    assert found["cpu_s_per_patient"] == 100.0 and found["rhat_max"] == {"median": 1.2, "largest": 1.2}
    assert summary([])["brier"] is None
