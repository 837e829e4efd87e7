"""From multipliers of r-hat and uncertain parameters to mean outlet flows, and the posterior's density on that."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from coronaryuq.core.ranks import Ranks
from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.model.tissue import PerGram
from coronaryuq.posterior.model.total_resistance import Conditioned, Rescaled
from coronaryuq.zerod.theta import Laws


class FlowModel(Protocol):
    """Any model of outlet flows: the 0D engine in campaigns."""

    def flows(self, inputs: np.ndarray) -> np.ndarray:
        """Mean flows (n, N), mL/s, nan where the model failed. Rows are independent.

        inputs (n, N + k): multipliers of the beds, then values of the network's uncertain parameters; without these,
        they are at their centres. With the prior per gram, a common factor on all beds lies between (n, N + 1 + k).
        """
        ...


@runtime_checkable
class WithSteadyFlows(FlowModel, Protocol):
    """A model of flows with a cheap approximation of them."""

    def steady(self, inputs: np.ndarray) -> np.ndarray:
        """Return flows (n, N) that cost little; over those of `flows` they vary little."""
        ...


Inverse = Callable[[np.ndarray], np.ndarray]
"""One over some flows (n, N), as a function of coordinates (n, d)."""


@dataclass(frozen=True)
class Response:
    """What each uncertain parameter alone does to the flows at r-hat.

    above, below (k, N): flows with its coordinate at 1 and at -1; that of a choice: at its centre. centre (N,): with
    all at 0. chosen (c, N): flows with each value of each choice, one choice after the other. numbers (k,): how many of
    these each parameter has, 0 unless it is a choice.
    """

    above: np.ndarray
    below: np.ndarray
    centre: np.ndarray
    chosen: np.ndarray
    numbers: np.ndarray

    def log_total(self, z: np.ndarray) -> np.ndarray:
        """Return log total flow over that at the centres, (n,), at stepped coordinates z (n, k) (`Laws.stepped`).

        The sum of a quadratic in each, and of a constant for each value of a choice.
        """
        centre, above, below = (np.log(flows.sum(axis=-1)) for flows in (self.centre, self.above, self.below))
        linear, square = 0.5 * (above - below), 0.5 * (above + below) - centre
        total = np.sum(linear * z + square * z**2, axis=1)
        for column in np.flatnonzero(self.numbers).tolist():
            first = int(self.numbers[:column].sum())
            own = self.chosen[first : first + int(self.numbers[column])]
            total = total + (np.log(own.sum(axis=1)) - centre)[z[:, column].astype(int)]
        return total

    @property
    def slope(self) -> np.ndarray:
        """Derivative of each logarithmic flow by each coordinate, (N, k)."""
        return 0.5 * np.log(self.above / self.below).T

    @property
    def slope_of_total(self) -> np.ndarray:
        """Derivative of the logarithm of the total by each coordinate, (k,)."""
        return 0.5 * np.log(self.above.sum(axis=1) / self.below.sum(axis=1))


def respond(model: FlowModel, laws: Laws, centre: np.ndarray) -> Response:
    """Run the model at r-hat with each uncertain parameter alone above and below its centre; centre: flows (N,) there.

    Raises `RuntimeError` if the model fails there.
    """
    k, beds = len(laws), len(centre)
    still = np.diag([float(column not in laws.choices) for column in range(k)]).reshape(k, k)
    at = laws.values(np.vstack([still, -still]))
    # A choice is at 0 in all runs but its own.
    at[:, list(laws.choices)] = 0.0
    numbers = np.array([len(laws.choices[c]) + 1 if c in laws.choices else 0 for c in range(k)])
    own = np.tile(laws.values(np.zeros((1, k))), (int(numbers.sum()), 1))
    own[:, list(laws.choices)] = 0.0
    own[range(len(own)), np.repeat(range(k), numbers)] = np.concatenate([np.arange(n) for n in numbers])
    values = np.vstack([at, own])
    flows = model.flows(np.hstack([np.ones((len(values), beds)), values]))
    failed = ~np.all(flows > 0, axis=1)
    if np.any(failed):
        name = [*laws.names, *laws.names, *np.repeat(laws.names, numbers)][int(np.argmax(failed))]
        raise RuntimeError(f"the model fails near the centre of {name}; give it less spread")
    return Response(flows[:k], flows[k : 2 * k], centre, flows[2 * k :], numbers)


class Posterior:
    """Log density of the posterior in the coordinates of the constraint; rows are shared out among ranks.

    response: of the model to its uncertain parameters, None without any. total_known: whether the total of the targets
    is a measurement. If not, they are scaled to the model's total at r-hat, which depends on the parameters: flows are
    then given in the unit of the targets, divided by that total over the one at z = 0, so that shares of flow inform
    the parameters, and its total does not. With `PerGram` they are what the map is expected to read of them. steady:
    whether emulators start from the model's steady flows, if it has any.
    """

    def __init__(
        self, model: FlowModel, space: Conditioned | Rescaled | PerGram, likelihood: Likelihood,
        ranks: Ranks | None = None, response: Response | None = None, total_known: bool = False, steady: bool = False,
    ):  # fmt: skip
        self.model, self.space, self.likelihood, self.response = model, space, likelihood, response
        self.total_known = total_known
        self.nearly = model.steady if steady and isinstance(model, WithSteadyFlows) else None
        self.ranks = ranks if ranks is not None else Ranks()
        self.failures = 0

    def flows(self, x: np.ndarray) -> np.ndarray:
        """Flows (n, N) in the unit of the targets at coordinates x (n, d), computed by all ranks together."""
        return self._in_unit_of_targets(self.ranks.map_rows(self.model.flows, self.space.inputs(x)), x)

    @property
    def inverse_steady(self) -> Inverse | None:
        """One over the model's steady flows, in the unit of `flows`; None without any."""
        nearly = self.nearly
        if nearly is None:
            return None
        return lambda x: 1.0 / self._in_unit_of_targets(nearly(self.space.inputs(x)), x)

    def _in_unit_of_targets(self, flows: np.ndarray, x: np.ndarray) -> np.ndarray:
        if isinstance(self.space, PerGram):
            return flows * self.space.reading.over_flow(self.space.multipliers(x))
        if self.response is None or self.total_known:
            return flows
        return flows / np.exp(self.response.log_total(self.space.laws.stepped(self.space.standard(x))))[:, None]

    @property
    def slope(self) -> np.ndarray | None:
        """Derivative of each logarithmic flow by the coordinate of each uncertain parameter, (N, k), or None."""
        if self.response is None or self.total_known:
            return None if self.response is None else self.response.slope
        return self.response.slope - self.response.slope_of_total

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Log density (n,) and flows (n, N); -inf and nan outside the prior and where the model failed."""
        log_density = self.space.log_prior(x)
        flows = np.full((len(x), len(self.likelihood.mean)), np.nan)
        inside = np.isfinite(log_density)
        if np.any(inside):
            flows[inside] = self.flows(x[inside])
        failed = inside & ~np.all(np.isfinite(flows), axis=1)
        self.failures += int(failed.sum())
        good = inside & ~failed
        log_density[failed] = -np.inf
        log_density[good] += self.likelihood.log_density(flows[good])
        return log_density, flows
