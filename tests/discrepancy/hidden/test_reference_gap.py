"""What answers are measured against."""

import numpy as np
import pytest

from coronaryuq.discrepancy.hidden.reference_gap import fit_known
from coronaryuq.discrepancy.inference.gauss_newton import Fit

BASE = Fit(np.array([2.0, -1.0]), np.zeros(3), np.zeros((3, 2)))


class TwoModes:
    """Fits stay where they start; one from `good` meets the data, others do not, and far from it none runs."""

    count = 2

    def __init__(self, good):
        self.good = good

    def corrected(self, acting, fit):
        return self, fit

    def converge(self, acting, fit):
        return fit

    def calibrate_each(self, wanted):
        misfits = [5.0 * np.linalg.norm(start[:2] - self.good) for _, start in wanted]
        fits = [Fit(start, np.array([m, 0.0]), np.zeros((2, 3))) for (_, start), m in zip(wanted, misfits, strict=True)]
        return [None if fit.residual[0] > 20.0 else fit for fit in fits]


def test_there_is_no_reference_if_no_start_runs():
    with pytest.raises(FloatingPointError, match="the hidden effects"):
        fit_known(TwoModes(np.array([40.0, 40.0])), [], np.array([0.7]), BASE)


@pytest.mark.parametrize("good", [(0.0, 0.0), (2.0, -1.0), (6.0, -1.0)])
def test_the_reference_is_the_better_of_two_fits(good):
    _, found = fit_known(TwoModes(np.array(good)), [], np.array([0.7]), BASE)
    assert found.z.tolist() == [*((0.0, 0.0) if good == (0.0, 0.0) else (2.0, -1.0)), 0.7]
