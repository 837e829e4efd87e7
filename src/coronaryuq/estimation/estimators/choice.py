"""Which of several estimates of one mean to recommend, all from the same runs.

The smallest of several reported variances is likely to be one that is too small by chance: over many pilots, estimators
chosen that way report less than their error. `crossfit-GP` needs no such choice, because its selector compares the
control variates of MC and MFMC with others within each training set, never on the runs that the variance comes from.
Another estimator therefore takes its place only if its variance is smaller by more than one standard error of the
difference (Breiman, Friedman, Olshen and Stone 1984, section 3.4.3).
"""

from collections.abc import Mapping

import numpy as np

from coronaryuq.estimation.estimators.crossfit import Estimate
from coronaryuq.estimation.estimators.dependence import Segments

TESTED = ("MC", "MFMC", "BLUE", "crossfit-GP")
"""Estimators whose coverage repeated trials have tested (docs/explanation/estimation.md).

MFMC-AE is not: α of a fold depends on the others' networks, whose error is not in its variance; `multilevel` has been
tested on one problem only.
"""


def recommended(estimates: Mapping[str, Estimate]) -> str:
    """Return the name of the recommended estimator; one with a warning that speaks against it is never recommended.

    Where `crossfit-GP` has such a warning, or no smaller variance than plain Monte Carlo, that takes its place. What is
    compared are the variances that the samples themselves show, the same samples for all estimators: without the error
    of a chain that all share, and without the extrapolation factor, which says of `crossfit-GP` what holds for the
    others, too, but nobody knows.
    """
    sound = [name for name in TESTED if name in estimates and (name == "MC" or estimates[name].sound)]
    seen = {name: estimates[name].contributions.variance for name in sound}
    usual = "crossfit-GP" if seen.get("crossfit-GP", np.inf) < seen["MC"] else "MC"
    better = [name for name in sound if seen[usual] - seen[name] > uncertainty(estimates[name], estimates[usual])]
    return min(better, key=lambda name: seen[name], default=usual)


def uncertainty(one: Estimate, other: Estimate) -> float:
    """Return the standard error of the difference of the variances that the same samples show of two estimates.

    A variance is a sum of squares over runs, or over segments of runs that depend on each other; that of propagation
    samples counts where it comes from segments.
    """
    a, b = one.contributions, other.contributions
    found = _spread(a.pilot, b.pilot, a.dependence.pilot)
    segments = a.segments or b.segments
    if segments is not None and not a.dependence.shared:
        one_part, other_part = (c.propagated if len(c.propagated) else np.zeros(len(segments.long)) for c in (a, b))
        found += _spread(one_part, other_part, segments)
    return float(found**0.5)


def _spread(a: np.ndarray, b: np.ndarray, segments: Segments | None) -> float:
    """Return the variance of Σ a² − Σ b² over samples, or over segments, where it is three times as large.

    Three times as in `dependence.variance`, which combines segments of two lengths.
    """
    if segments is None:
        difference = a**2 - b**2
    else:
        label = np.unique(segments.long, return_inverse=True)[1]
        difference = np.bincount(label, a) ** 2 - np.bincount(label, b) ** 2
    of_one = float(np.var(difference, ddof=1)) if len(difference) > 1 else 0.0
    return len(difference) * of_one * (1 if segments is None else 3)
