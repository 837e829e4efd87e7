"""The prior of `uncertainty: full`: beds of equal tissue conduct equally, within a stated spread.

Shares of conductance that follow the measured flow, as in the paper, cannot tell a stenosis from a bed of high
resistance: behind a tight stenosis little flow is measured, the bed is given a high resistance, and with the segmented
lumen the pressure hardly falls. What tells them apart is the tissue: under hyperaemia a gram conducts about as much in
one territory as in another, so that a territory with less flow per gram points to its artery.

Let a_i be bed i's share of the mass and m_i the multiplier of its resistance at r-hat, where its share of conductance
is w_i. Then

    log m_i = log(w_i / a_i) + t + e_i,

e normal with the standard deviation and the correlation within an artery that `case.yaml` states, and t, normal and as
good as flat, the level that all beds share: the map's total flow informs it.

Where the borders of territories lie is uncertain, too. With a border drawn wrongly, an outlet's tissue and its measured
flow are too large or too small by one factor exp(b_i), so that flow per gram does not see it:

    log m_i = log(w_i / a_i) + b_i + t + e_i,    reading_i = flow_i exp(b_i) (1 + noise).

b is normal. Given the resistances, it has the expectation G (log m - log(w / a)) and the covariance that is left of it,
so that no coordinate is needed: the likelihood compares flows times the exponential of that expectation with the map,
and the covariance joins the noise. In θ, s is the factor on the total
resistance of these beds, which also acts on all others, and r_i = m_i / s, so that r preserves that total as in
`total_resistance`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.posterior.reading import Reading
from coronaryuq.zerod.network.beds import SCALING
from coronaryuq.zerod.theta import Laws

LEVEL = 1.0
"""Standard deviation of t: a factor of e either way, where the calibration of a map is known to some ten per cent."""


@dataclass(frozen=True)
class Tissue:
    """The tissue that N beds supply.

    mass (N,): in any unit. arteries (N,): the artery of each bed. spread: standard deviation of the logarithm of
    conductance per mass. correlation: of two beds of one artery. borders (N, N): covariance of b; None: known borders.
    """

    mass: np.ndarray
    arteries: Sequence[str]
    spread: float
    correlation: float
    borders: np.ndarray | None = None

    def covariance(self) -> np.ndarray:
        """Return the covariance (N, N) of the logarithms of resistance per mass, the common level included."""
        together = np.equal.outer(np.array(self.arteries), np.array(self.arteries))
        own = self.spread**2 * (self.correlation * together + (1.0 - self.correlation) * np.eye(len(together)))
        return LEVEL**2 + own + (0.0 if self.borders is None else self.borders)


class PerGram:
    """Coordinates (n, N + k), all independent and standard normal in the prior: those of the beds, then z.

    Parameters
    ----------
    weights
        Shares of conductance at r-hat (N,).
    tissue
        Of the beds.
    laws
        Of the k uncertain parameters of the network.
    """

    box = None
    adjust = None
    further = (SCALING,)
    """Inputs of the model between the multipliers and the parameters."""

    def __init__(self, weights: np.ndarray, tissue: Tissue, laws: Laws | None = None):
        self.weights = np.asarray(weights, dtype=float) / np.sum(weights)
        self.laws = Laws() if laws is None else laws
        self.beds = len(self.weights)
        self.dimension = self.beds + len(self.laws)
        self.centre = np.log(self.weights * np.sum(tissue.mass) / tissue.mass)
        # Of a spread of zero the covariance has rank one; the least variance keeps its root.
        covariance = tissue.covariance() + 1e-10 * np.eye(self.beds)
        self.root = np.linalg.cholesky(covariance)
        borders = np.zeros_like(covariance) if tissue.borders is None else tissue.borders
        self.gain = np.linalg.solve(covariance, borders).T
        self.left = borders - self.gain @ borders
        """Covariance (N, N) of b given the resistances."""

    @property
    def prior_precision(self) -> np.ndarray:
        """Diagonal (d,) of the prior's precision."""
        return np.ones(self.dimension)

    def multipliers(self, x: np.ndarray) -> np.ndarray:
        """Return multipliers m (n, N) of r-hat, the common factor s included."""
        return np.exp(self.centre + np.sum(x[:, None, : self.beds] * self.root[None], axis=2))

    @property
    def reading(self) -> "Reading":
        """What the map is expected to read of the flow of a bed, over that flow."""
        return Reading(self.gain, self.centre)

    def standard(self, x: np.ndarray) -> np.ndarray:
        """Return the coordinates z (n, k)."""
        return x[:, self.beds :]

    def stepped(self, x: np.ndarray) -> np.ndarray:
        """Return the coordinates with those of choices replaced by the number that they choose, for an emulator."""
        if not self.laws.choices:
            return x
        return np.hstack([x[:, : self.beds], self.laws.stepped(self.standard(x))])

    def inputs(self, x: np.ndarray) -> np.ndarray:
        """Return r, s and values of the uncertain parameters, (n, N + 1 + k)."""
        m = self.multipliers(x)
        s = 1.0 / np.sum(self.weights / m, axis=1, keepdims=True)
        return np.hstack([m / s, s, self.laws.values(self.standard(x))])

    def coordinates(self, multipliers: np.ndarray) -> np.ndarray:
        """Return the coordinates (n, N + k) of multipliers m (n, N), with z = 0."""
        own = np.linalg.solve(self.root, (np.log(multipliers) - self.centre).T).T
        return np.hstack([own, np.zeros((len(own), len(self.laws)))])

    def log_prior(self, x: np.ndarray) -> np.ndarray:
        """Return the log density (n,) up to a constant."""
        return -0.5 * np.sum(x**2, axis=1)

    def draw(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Return independent draws (count, N + k) of the prior."""
        return random.standard_normal((count, self.dimension))

    def outside(self, multipliers: np.ndarray) -> np.ndarray:
        """Return whether each multiplier (N,) lies outside the prior, which has no bounds."""
        return np.zeros(len(multipliers), dtype=bool)

    def ranges(self, share: tuple[float, float]) -> np.ndarray:
        """Return the quantiles (N, 2) of each r in the prior."""
        drawn = self.inputs(self.draw(generator(1, "posterior", "prior ranges"), 20_000))[:, : self.beds]
        return np.quantile(drawn, share, axis=0).T
