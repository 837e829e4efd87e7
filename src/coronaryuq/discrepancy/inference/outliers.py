"""Outliers: single samples of waveforms that deviate from the line between their neighbours, most likely artefacts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from coronaryuq.core.scatter import far_off
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.inference.problem import Problem


@dataclass(frozen=True)
class Outlier:
    """A sample (time in s), and its deviation from its neighbours in standard deviations."""

    quantity: str
    location: str
    condition: str
    time: float
    off: float

    def of(self, series: Measured) -> bool:
        """Return whether the sample is one of a waveform."""
        same = (self.quantity, self.location, self.condition) == (series.quantity, series.location, series.condition)
        return same and series.statistic == "waveform"


def samples_of(outliers: Sequence[Outlier], measured: Sequence[Measured]) -> np.ndarray:
    """Return which samples of all series are outliers: (N,), bool."""
    of_series = [(one, [outlier.time for outlier in outliers if outlier.of(one)]) for one in measured]
    return np.concatenate([np.isin(one.value if one.time is None else one.time, times) for one, times in of_series])


def find_outliers(problem: Problem, residual: np.ndarray) -> list[Outlier]:
    """Return the outliers among the whitened residuals (N,) of all data, worst first.

    A sample's distance from the line between its neighbours is divided by its standard deviation under white noise, or
    by what most samples of the waveform are off, if that is larger (`far_off`).
    Samples that stand out at the same time of the beat in more series than by chance are not artefacts: each series has
    as many, at times that do not depend on those of others.
    """
    found, limit = [], float(stats.norm.isf(0.5 * RULE.outlier / residual.size))
    for number, series in ((n, one) for n, one in enumerate(problem.forward.measured) if one.time is not None):
        for sample, off in far_off(series.sample_times, residual[problem.owner == number], limit, series.period):
            time = float(series.sample_times[sample])
            found.append((Outlier(*series.channel, series.condition, time, off), number, time / series.period))
    alone = []
    for outlier, owner, phase in found:
        near = RULE.same_time / problem.forward.measured[owner].value.size
        others = [(other, abs((phase - at + 0.5) % 1.0 - 0.5) < near) for _, other, at in found if other != owner]
        together, expected = len({other for other, same in others if same}), 2.0 * near * len(others)
        if stats.poisson.sf(together - 1, expected) > RULE.coincidence / len(found):
            alone.append(outlier)
    return sorted(alone, key=lambda outlier: -abs(outlier.off))
