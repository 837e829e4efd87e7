"""Rival: a Gaussian process fitted to the residuals, explained by the candidate whose sensitivity resembles it most."""

import numpy as np
from scipy import stats

from coronaryuq.bench.discrepancy.rivals.adapter import Class, RivalAnswer, Seen, first_sufficient
from coronaryuq.discrepancy.inference.gauss_newton import Fit

RANKED = 5
"""Number of candidates that are tried, the first of the ranking."""


class GaussianProcess:
    """Fit model and discrepancy together, and rank the candidates by the share of the discrepancy that each explains.

    Source: Kennedy & O'Hagan, J. R. Stat. Soc. B 63 (2001) 425. The process is that of our search
    (`gp_discrepancy.py`), its amplitude that of the largest evidence. The answer is "nothing" if the process is not
    significant; else the first of the ranking with which, fitted in full beside its lookalikes, it no longer is; else
    "something else".
    """

    name = "Gaussian process (Kennedy-O'Hagan)"

    def __init__(self, level: float):
        self.level = level

    def answer(self, seen: Seen) -> RivalAnswer:
        """Return the effect that explains the process."""
        trail: list[tuple[tuple[Class, ...], float]] = [((), significance(seen.fit))]
        amplitude = int(np.argmax(seen.fit.posterior.log_evidence))
        shares = explained(seen, discrepancy(seen.fit, amplitude))
        for number in np.argsort(-shares, kind="stable")[:RANKED]:
            if trail[-1][1] >= self.level:
                break
            found = seen.with_best(seen.linear.lookalikes(int(number)))
            if found is not None:
                trail.append(((found[1],), significance(found[0].fit)))
        return first_sufficient(tuple(trail), self.level)


def significance(fit: Fit) -> float:
    """Return the p-value of the likelihood ratio of the process to none.

    Amplitude zero is on the boundary, so that the ratio is a mixture of chi^2 with 0 and 1 degrees of freedom (Self &
    Liang, J. Am. Stat. Assoc. 82 (1987) 605).
    """
    evidence = fit.posterior.log_evidence
    ratio = 2.0 * float(evidence.max() - evidence[0])
    return 0.5 * float(stats.chi2.sf(ratio, 1)) if ratio > 0.0 else 1.0


def discrepancy(fit: Fit, amplitude: int) -> np.ndarray:
    """Return the mean (N,) of the discrepancy of a model at the amplitude of a number, whitened."""
    flexible = fit.flexible
    assert flexible is not None
    left = fit.at_zero - fit.jacobian @ fit.posterior.mean[amplitude]
    parts = flexible.explained[amplitude] * flexible.along(left[:, None])[:, 0]
    mean, first = np.zeros(len(left)), 0
    for rows, directions in flexible.blocks:
        last = first + directions.shape[1]
        mean[rows], first = directions @ parts[first:last], last
    return mean


def explained(seen: Seen, mean: np.ndarray) -> np.ndarray:
    """Return the fraction (n,) of a discrepancy (N,) that each column of the dictionary explains beside recalibration.

    Zero for a size of the impossible sign.
    """
    wanted = seen.linear.root(mean)
    along = wanted @ seen.linear.columns
    one_sided = np.array([c.one_sided for c in seen.linear.candidates], dtype=bool)
    along = np.where(one_sided, np.maximum(along, 0.0), along)
    return along**2 / max(float(wanted @ wanted), 1e-300)
