"""The numerical error of the 3D runs moves the estimates and widens their intervals."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.analysis.estimate_rows import analyse
from coronaryuq.estimation.analysis.numerical_budget import corrected, with_numerical_error
from coronaryuq.estimation.runs.table import Row
from coronaryuq.estimation.settings import Settings
from coronaryuq.flow3d.numerical_error import NumericalError, assumed_errors
from support.runs import runs_of

ROW = Row("ffr", "ffr_lad", "q", "FFR, FFR, LAD")
ERRORS = {
    "ffr_lad": [
        NumericalError("mesh", 0.01, 0.003, 0.8, 1.8, "richardson", 4, 0.001),
        NumericalError("time_step", 0.0, 0.004, 0.8, None, "two_levels", 4, 0.001),
    ]
}
"""Errors at an FFR of 0.8: of a fifth, what is lost."""


@pytest.fixture(scope="module")
def both():
    """Return the row of some runs without and with their numerical error."""
    random = generator(1, "numerical")
    theta, more = (np.exp(0.3 * random.normal(size=(n, 2))) for n in (40, 400))
    y = 0.8 + 0.05 * np.log(theta[:, 0]) + 0.002 * random.normal(size=40)
    runs = runs_of(theta, {"ffr_lad": y}, {"q": np.log(theta[:, 0])}, more)
    settings = Settings(autoencoder=False)
    (plain,) = analyse(runs, [ROW], settings, 1)
    (moved,) = analyse(corrected(runs, ERRORS), [ROW], settings, 1)
    return plain, with_numerical_error(moved, ERRORS)


def test_estimates_move_by_the_correction_and_their_variance_has_the_new_parts(both):
    plain, full = both
    for name, report in full.estimators.items():
        before = plain.estimators[name]
        loss = (1 - report.mean) / 0.2
        assert report.mean == pytest.approx(before.mean + 0.05 * (1 - before.mean), abs=2e-4)
        assert sum(report.variance.values()) == pytest.approx(report.std**2)
        assert report.variance["mesh"] == pytest.approx(9e-6 * loss**2)
        assert report.variance["time_step"] == pytest.approx(16e-6 * loss**2)
        assert report.calibrated.half_width > 1.96 * 0.005 * loss
    lost = 1 - full.recommended_report.mean
    assert full.numerical_correction == pytest.approx(0.05 * lost) and plain.numerical_correction is None


def test_quantiles_and_zones_move_and_widen(both):
    plain, full = both
    middle, before = full.beyond_the_mean.quantiles["0.50"], plain.beyond_the_mean.quantiles["0.50"]
    assert middle.value == pytest.approx(before.value + 0.05 * (1 - before.value), abs=1e-3)
    assert middle.high - middle.low > before.high - before.low
    errors = {share: value.std for share, value in full.beyond_the_mean.quantiles.items()}
    least = {share: 0.025 * (1 - value.value) for share, value in full.beyond_the_mean.quantiles.items()}
    assert all(errors[share] >= least[share] for share in errors), "in proportion to what is lost"
    high, before = full.beyond_the_mean.zones[-1], plain.beyond_the_mean.zones[-1]
    assert high.value > before.value and high.std > before.std
    assert all(0 <= zone.low <= zone.high <= 1 for zone in full.beyond_the_mean.zones)


def test_other_rows_stay(both):
    plain, _ = both
    other = replace(plain, column_3d="osi_max_lad")
    assert with_numerical_error(other, ERRORS) is other


def test_the_error_of_wall_shear_is_a_fraction_and_that_of_oscillation_is_not():
    error = NumericalError("mesh", 1.0, 1.0, 10.0, 2.0, "richardson", 4, 0.1)
    values = np.array([5.0, 20.0])
    assert error.grown("tawss_min_lad", values) == pytest.approx([0.5, 2.0])
    assert error.grown("pressure_drop_lad", values) == pytest.approx([0.5, 2.0])
    assert error.grown("osi_max_lad", values) == pytest.approx([1.0, 1.0])
    for hardly_lost in (1.0, 0.999, 1.001):
        small = replace(error, correction=0.001, std=0.002, at=hardly_lost)
        assert small.grown("ffr_lad", np.array([0.9, 1.0])) == pytest.approx([1.0, 1.0])


def test_what_is_assumed_widens_without_a_correction(both):
    plain, _ = both
    full = with_numerical_error(plain, assumed_errors(4.0, ["ffr_lad", "osi_max_lad"]))
    assert full.numerical_correction is None
    for name, report in full.estimators.items():
        assert report.mean == plain.estimators[name].mean
        assert report.variance["assumed"] == pytest.approx(((1 - report.mean) / 48) ** 2)
    assert set(assumed_errors(4.0, ["osi_max_lad", "tawss_min_lad", "lowest_ffr_lad"])) == {"lowest_ffr_lad"}
