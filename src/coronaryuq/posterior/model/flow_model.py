"""From multipliers of r-hat to mean outlet flows, and the posterior's density on top of that."""

from typing import Protocol

import numpy as np

from coronaryuq.core.ranks import Ranks
from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.model.total_resistance import Conditioned, Rescaled


class FlowModel(Protocol):
    """Any model of outlet flows: the 0D engine in campaigns."""

    def flows(self, multipliers: np.ndarray) -> np.ndarray:
        """Mean flows (n, N), mL/s, at multipliers (n, N); nan where the model failed. Rows are independent."""
        ...


class Posterior:
    """Log density of the posterior in the coordinates of the constraint; rows are shared out among ranks."""

    def __init__(
        self, model: FlowModel, space: Conditioned | Rescaled, likelihood: Likelihood, ranks: Ranks | None = None
    ):
        self.model, self.space, self.likelihood = model, space, likelihood
        self.ranks = ranks if ranks is not None else Ranks()
        self.failures = 0

    def flows(self, multipliers: np.ndarray) -> np.ndarray:
        """Flows (n, N) of the model, computed by all ranks together."""
        return self.ranks.map_rows(self.model.flows, multipliers)

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Log density (n,) and flows (n, N); -inf and nan outside the prior and where the model failed."""
        log_density = self.space.log_prior(x)
        flows = np.full((len(x), len(self.likelihood.mean)), np.nan)
        inside = np.isfinite(log_density)
        if np.any(inside):
            flows[inside] = self.flows(self.space.multipliers(x[inside]))
        failed = inside & ~np.all(np.isfinite(flows), axis=1)
        self.failures += int(failed.sum())
        good = inside & ~failed
        log_density[failed] = -np.inf
        log_density[good] += self.likelihood.log_density(flows[good])
        return log_density, flows
