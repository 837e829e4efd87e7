"""Rival: sparse regression of the residuals on the candidates' linear responses, as in SINDy."""

import warnings
from math import comb, log

import numpy as np

from coronaryuq.bench.discrepancy.rivals.adapter import MOST_NAMES, Class, RivalAnswer, Seen, first_sufficient
from coronaryuq.core.errors import InputError

THRESHOLDS = np.geomspace(3.0, 200.0, 25)
"""Thresholds that are tried, of a response in noise standard deviations; the smallest is exceeded by chance in one
of 370 responses."""
RIDGE = (1e-4, 1e-2, 0.1, 1.0)
"""Weights of the ridge penalty that are tried, for columns of unit norm."""


class SparseRegression:
    """Sequentially thresholded least squares, with the optimiser of PySINDy; then test what is left.

    Source: Brunton, Proctor & Kutz, PNAS 113 (2016) 3932. The dictionary are the responses of all candidates, linear
    about the recalibrated model. Threshold and ridge penalty minimise an information criterion of the selected terms
    (Mangan et al., Proc. R. Soc. A 473 (2017) 20170009), here EBIC. Only selections of three terms or fewer are
    considered. Each is fitted in full beside its lookalikes, and what is left is tested at the level `left_over`.
    """

    name = "sparse regression (SINDy)"

    def __init__(self, left_over: float):
        self.left_over = left_over

    def answer(self, seen: Seen) -> RivalAnswer:
        """Return the effects with coefficients other than zero."""
        present = seen
        classes: list[Class] = []
        for number in select(seen.linear.columns, seen.linear.data):
            used = {placed for members in classes for placed in members}
            found = present.with_best([c for c in seen.linear.lookalikes(number) if c.placed not in used])
            if found is not None:
                present, members = found
                classes.append(members)
        return first_sufficient(((tuple(classes), present.misfit),), self.left_over)


def select(columns: np.ndarray, data: np.ndarray) -> list[int]:
    """Return the columns selected, at most `MOST_NAMES`, largest coefficient first.

    Parameters
    ----------
    columns
        Dictionary, columns of unit norm: (N, n).
    data
        Data in noise standard deviations: (N,).

    Raises
    ------
    InputError
        If PySINDy is not installed.
    """
    try:
        from pysindy.optimizers import STLSQ
    except ImportError:
        raise InputError("bench discrepancy", "--rivals", "sparse regression", "pip install pysindy") from None
    total = columns.shape[1]
    best: tuple[float, list[int]] = float(data @ data), []
    for ridge in RIDGE if total else ():
        for threshold in THRESHOLDS:
            optimiser = STLSQ(threshold=threshold, alpha=ridge, max_iter=total + 1, unbias=True)
            with warnings.catch_warnings():
                # It warns if no term is left.
                warnings.simplefilter("ignore")
                optimiser.fit(columns, data[:, None])
            coefficients = optimiser.coef_[0]
            terms = [int(i) for i in np.argsort(-np.abs(coefficients)) if coefficients[i] != 0.0]
            if not 0 < len(terms) <= MOST_NAMES:
                continue
            left = data - columns[:, terms] @ np.linalg.lstsq(columns[:, terms], data, rcond=None)[0]
            value = float(left @ left) + len(terms) * log(len(data)) + 2.0 * log(comb(total, len(terms)))
            if value < best[0]:
                best = value, terms
    return best[1]
