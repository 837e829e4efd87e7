"""What the posterior stage writes, as types: `chains.npz` and `summary.json` (docs/reference/formats.md)."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import read_npz, write_npz
from coronaryuq.core.io.typed import checked
from coronaryuq.posterior.reading import Reading
from coronaryuq.zerod.network.beds import SCALING

PRIOR_SHARE = (0.025, 0.975)
"""Quantiles between which the prior of a multiplier is stated."""


@dataclass(frozen=True)
class Chains:
    """All chains of one posterior, n recorded states each, N beds, k uncertain parameters of the network.

    names (N,): of the beds. multipliers, flows (chains, n, N): of r-hat, and mL/s in the unit of the targets.
    reading_gain (N, N), reading_centre (N,): what a map is expected to read of them (`posterior.reading`).
    parameter_names (k,), parameters (chains, n, k): values of the uncertain parameters. log_density (chains, n).
    log_weight (chains, n): log of the model's over the emulator's density at each proposal, up to a constant; nan
    without an emulator. burn_in: recorded states to discard. every: generations per recorded state. generations: per
    chain, burn-in included. length: of what follows burn-in, over that of the first chains. accepted, screen_accepted
    (chains,), proposed, screen_proposed: moves after burn-in on the model and on the emulator. emulator_error (N,): of
    log flow; empty without an emulator. independent: chains of independence steps. pilot_k_hat: Pareto k of the pilot
    runs, nan without them. refused: why no independence steps were taken, empty if they were or were not asked for.
    runs, failures: of the model. outliers: chains restarted. crossover: probability of each crossover value. weights
    (N,): shares of conductance at r-hat. target_scale: factor on the targets; target_mean (N,), target_covariance
    (N, N): scaled. prior_ranges (N, 2): of each multiplier, `PRIOR_SHARE`. fit_*: the resistances at which the model's
    flows are shared as the targets are; fit_outside (N,): which of them lie outside the prior.
    """

    names: list[str]
    multipliers: np.ndarray
    parameter_names: list[str]
    parameters: np.ndarray
    flows: np.ndarray
    log_density: np.ndarray
    log_weight: np.ndarray
    burn_in: int
    every: int
    generations: int
    length: int
    accepted: np.ndarray
    proposed: int
    screen_accepted: np.ndarray
    screen_proposed: int
    emulated: bool
    emulator_error: np.ndarray
    independent: bool
    pilot_k_hat: float
    refused: str
    runs: int
    failures: int
    outliers: int
    crossover: np.ndarray
    weights: np.ndarray
    target_scale: float
    target_mean: np.ndarray
    target_covariance: np.ndarray
    reading_gain: np.ndarray
    reading_centre: np.ndarray
    prior_ranges: np.ndarray
    fit_multipliers: np.ndarray
    fit_flows: np.ndarray
    fit_error: float
    fit_outside: np.ndarray

    @property
    def kept_multipliers(self) -> np.ndarray:
        """Multipliers (chains, kept, N) after burn-in."""
        return self.multipliers[:, self.burn_in :]

    @property
    def kept_parameters(self) -> np.ndarray:
        """Values of uncertain parameters (chains, kept, k) after burn-in."""
        return self.parameters[:, self.burn_in :]

    @property
    def kept_readings(self) -> np.ndarray:
        """Readings (chains, kept, N) that are expected of the flows after burn-in, mL/s."""
        if SCALING not in self.parameter_names:
            return self.kept_flows
        scaling = self.kept_parameters[..., self.parameter_names.index(SCALING), None]
        multipliers = (self.kept_multipliers * scaling).reshape(-1, len(self.names))
        over_flow = Reading(self.reading_gain, self.reading_centre).over_flow(multipliers)
        return self.kept_flows * over_flow.reshape(self.kept_flows.shape)

    @property
    def kept_flows(self) -> np.ndarray:
        """Flows (chains, kept, N) after burn-in."""
        return self.flows[:, self.burn_in :]

    @property
    def kept_log_density(self) -> np.ndarray:
        """Log densities (chains, kept) after burn-in."""
        return self.log_density[:, self.burn_in :]

    def write(self, path: str | Path, also: Mapping[str, Any] | None = None) -> None:
        """Write them; also: other arrays for the same file, which `read` leaves out."""
        write_npz(path, {field.name: np.array(getattr(self, field.name)) for field in fields(self)} | dict(also or {}))

    @classmethod
    def read(cls, path: str | Path) -> "Chains":
        """Read chains; `InputError` for a broken file or a missing array."""
        names = tuple(field.name for field in fields(cls))
        held = read_npz(path, names)
        arrays = {name: held[name] for name in names}
        scalars = {name: array.item() for name, array in arrays.items() if array.ndim == 0}
        texts = {name: [str(one) for one in arrays[name]] for name in ("names", "parameter_names")}
        return cls(**arrays | scalars | texts)


@dataclass(frozen=True)
class Diagnosis:
    """Have the chains converged? Rank-normalised split R-hat and effective sample sizes (Vehtari et al. 2021)."""

    converged: bool
    verdict: str
    worst_parameter: str
    rhat_max: float
    rhat: dict[str, float]
    ess_bulk: dict[str, float]
    ess_tail: dict[str, float]
    ess_bulk_min: float
    ess_tail_min: float


@dataclass(frozen=True)
class EmulatorUse:
    """acceptance: of proposals on the emulator; None without one. error_of_log_flow: held out, per bed."""

    used: bool
    generations_per_decision: int
    acceptance: float | None
    error_of_log_flow: list[float]


@dataclass(frozen=True)
class IndependenceUse:
    """Were independence steps taken, and how good is the emulator for them?

    k_hat: Pareto k of the ratios of model to emulator at all proposals, also those of delayed acceptance; pilot_k_hat:
    at the last pilot runs, which decide. Both are None where no such runs were made. warning: why DREAM ran instead,
    and that the emulator is too poor for either.
    """

    used: bool
    pilot_k_hat: float | None
    k_hat: float | None
    warning: str | None


@dataclass(frozen=True)
class FitToFractions:
    """The fit to the target fractions: multipliers of r-hat, flows (mL/s), and the beds outside the prior."""

    multipliers: dict[str, float]
    flows: dict[str, float]
    largest_fraction_error: float
    outside_prior: list[str]


@dataclass(frozen=True)
class Marginal:
    """One multiplier or uncertain parameter over the draws."""

    mean: float
    sd: float
    q025: float
    median: float
    q975: float


@dataclass(frozen=True)
class TotalFlow:
    """Flow of all beds together (mL/s): target, mean and standard deviation of the draws."""

    target: float
    mean: float
    sd: float


@dataclass(frozen=True)
class Predictive:
    """Comparison of N simulated flows (mL/s) with the targets; see `model.predictive.check`."""

    coverage_95: float
    outside_95: list[str]
    mahalanobis: float
    mean_squared_mahalanobis: float
    p_value: float
    relative_error_of_mean: dict[str, float]
    largest_fraction_error: float
    flow_mean: list[float]
    flow_sd: list[float]
    flow_covariance: list[list[float]]
    target_mean: list[float]
    target_covariance: list[list[float]]
    target_covariance_given_total: list[list[float]]
    sd_ratio: list[float]
    correlation_rms: float
    correlation_of_correlations: float | None
    covariance_error: float
    total_flow: TotalFlow


@dataclass(frozen=True)
class ReferenceShares:
    """Shares of conductance at r-hat beside those of the target flows."""

    conductance_share: dict[str, float]
    target_share: dict[str, float]
    largest_relative_difference: float


@dataclass(frozen=True)
class Summary(Diagnosis):
    """`summary.json`: verdict on the chains, the fit, marginals, and predictive checks.

    prior_ranges: of each multiplier, central 95 %. constraint: on the total resistance, "per gram" for none.
    effective_per_run: smallest bulk effective sample size over `model_runs`, which counts every run of the 0D model.
    """

    chains: int
    generations: int
    recorded_per_chain: int
    draws: int
    acceptance: float
    emulator: EmulatorUse
    independence: IndependenceUse
    model_runs: int
    effective_per_run: float
    failed_runs: int
    outlier_chains_restarted: int
    crossover_probabilities: list[float]
    constraint: str
    target_scale: float
    fit: FitToFractions
    prior_ranges: dict[str, tuple[float, float]]
    multipliers: dict[str, Marginal]
    parameters: dict[str, Marginal]
    most_probable_draw: dict[str, float]
    predictive: Predictive
    r_hat: ReferenceShares
    provenance: dict[str, Any]


def read_summary(path: str | Path) -> Summary:
    """Read `summary.json`; `InputError` for a file that is not one."""
    return checked(Summary, read_json(path, ("converged",)), path)
