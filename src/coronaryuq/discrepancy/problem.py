"""One discrepancy problem: the data, which of them may be fitted, and fits of models with and without effects."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.discrepancy.forward import Acting, Forward
from coronaryuq.discrepancy.inference import Fit, Search, maximise
from coronaryuq.discrepancy.settings import Settings

START_SIZES = (-1.0, 0.0, 1.0, -2.0, 2.0)
"""Starting points of an effect's sizes, in prior standard deviations."""


@dataclass
class Problem:
    """Data y (N,) with standard deviations sd (N,), the model's floor included, and the rows that may be fitted."""

    forward: Forward
    settings: Settings
    train: np.ndarray

    def __post_init__(self):
        series = self.forward.measured
        self.y = np.concatenate([s.value for s in series])
        floor = [np.full(s.value.size, self.settings.model_floor * np.abs(s.value).max()) for s in series]
        self.sd = np.hypot(np.concatenate([s.sd for s in series]), np.concatenate(floor))
        self.owner = np.repeat(np.arange(len(series)), [s.value.size for s in series])
        self.condition = np.array([s.condition for s in series])[self.owner]
        self.count = len(self.forward.nuisances)

    def whitened(self, rows: list[tuple[np.ndarray, list[Acting]]]) -> np.ndarray:
        """(y - f) / sd for rows (z, acting): (n, N)."""
        return (self.y - self.forward.predict_rows(rows)) / self.sd

    def _fitted(self, rows):
        return self.whitened(rows)[:, self.train]

    def calibrate(self, acting: list[Acting], start: np.ndarray | None = None) -> Fit:
        """Fit nuisance parameters and sizes together, all sensitivities recomputed at every step (fitted rows only)."""
        if start is None:
            start = np.zeros(self.count + len(self.forward.parameters(acting)))
        search = Search(list(acting), np.array(start, dtype=float), list(range(len(start))))
        maximise(self._fitted, [search], self.settings.iterations)
        if search.failed:
            raise FloatingPointError("the model could not be run")
        return search.fit

    def fit_candidates(self, base: Fit, acting: list[Acting], candidates: list[Acting]) -> list[Fit | None]:
        """Fit one more effect each, from several sizes; sensitivities to what is already there stay those of `base`.

        Returns the best fit of each candidate, None where no run succeeded.
        """
        searches, owners = [], []
        for number, candidate in enumerate(candidates):
            extra = len(candidate[0].parameters)
            for size in START_SIZES[: self.settings.starts]:
                z = np.concatenate([base.z, np.full(extra, size)])
                jacobian = np.hstack([base.jacobian, np.zeros((len(base.residual), extra))])
                fresh = list(range(len(base.z), len(z)))
                searches.append(Search([*acting, candidate], z, fresh, jacobian))
                owners.append(number)
        maximise(self._fitted, searches, self.settings.iterations)
        found: list[Fit | None] = [None] * len(candidates)
        for owner, search in zip(owners, searches, strict=True):
            if not search.failed and search.residual is not None:
                best = found[owner]
                if best is None or search.fit.evidence > best.evidence:
                    found[owner] = search.fit
        return found

    def sensitivity(self, z: np.ndarray, acting: list[Acting]) -> np.ndarray:
        """Whitened sensitivities (N, p) of all rows, held-out ones included."""
        moved = np.repeat(z[None, :], len(z) + 1, axis=0)
        step = 0.1
        moved[np.arange(1, len(z) + 1), np.arange(len(z))] += step
        found = self.whitened([(row, list(acting)) for row in moved])
        return -((found[1:] - found[0]) / step).T
