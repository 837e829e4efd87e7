"""The JSON files of the estimation stage as types: `estimates.json`, `budget.json`, `convergence.json`, `round_R.json`.

Writers and readers share them. A field with a default is left out of the file where it is None;
docs/reference/formats.md describes the files.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.typed import checked


@dataclass(frozen=True)
class Interval:
    """A two-sided interval of nominal `level` (0 to 1)."""

    low: float
    high: float
    level: float

    @property
    def half_width(self) -> float:
        return (self.high - self.low) / 2

    def holds(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Value:
    """An estimated quantity with its reported standard error and interval.

    warning: why the coverage of its interval is not tested, where it is not.
    """

    value: float
    std: float
    low: float
    high: float
    level: float
    warning: str | None = None

    def holds(self, truth: float) -> bool:
        return self.low <= truth <= self.high


@dataclass(frozen=True)
class Probability(Value):
    """Probability that the quantity is above `above` and at or below `at_most`, None where there is no such limit."""

    above: float | None = None
    at_most: float | None = None

    @property
    def zone(self) -> str:
        """The zone in symbols, the quantity being FFR."""
        below = "" if self.at_most is None else f" ≤ {self.at_most:.2f}"
        if self.above is None:
            return f"FFR{below}"
        return f"{self.above:.2f} < FFR{below}" if below else f"FFR > {self.above:.2f}"

    @property
    def complement(self) -> "Probability":
        """Probability of everything up to this zone, which must be the highest."""
        return Probability(1 - self.value, self.std, 1 - self.high, 1 - self.low, self.level, at_most=self.above)


@dataclass(frozen=True)
class BeyondTheMean:
    """Quantities other than the mean.

    quantiles: share ("0.05") → value, over the states. predictive: share → quantile of the patient's value, which also
    holds the errors of `quantiles`, statistical and numerical. zones: of FFR, in rising order; their probabilities add
    up to one. sobol_first_order, sobol_total, shapley: input (the last two: or group of inputs) → index. by_source:
    source of uncertainty → Shapley effect of its inputs together, if more than flow is uncertain.
    """

    variance: Value | None = None
    quantiles: dict[str, Value] | None = None
    predictive: dict[str, float] | None = None
    zones: list[Probability] | None = None
    sobol_first_order: dict[str, Value] | None = None
    sobol_total: dict[str, Value] | None = None
    shapley: dict[str, Value] | None = None
    by_source: dict[str, Value] | None = None


@dataclass(frozen=True)
class PaperRow:
    """The paper's own numbers for a row: correlation, standard deviations of MC and MFMC."""

    rho_original: float
    std_mc: float
    std_mfmc: float


STATISTICAL = ("runs_3d", "propagation", "chain")
NUMERICAL = ("mesh", "time_step", "cycles", "assumed")
SOURCES = (*STATISTICAL, *NUMERICAL)
"""Of the variance of an estimate."""


@dataclass(frozen=True)
class EstimatorReport:
    """One estimator of one row.

    variance: of the mean by its source; they add up to the square of `std`: `runs_3d` (residuals), `propagation`,
    `chain`, and `mesh`, `time_step`, `cycles` where the campaign measured them, or `assumed` in their place. n_0d: 0D
    runs made. predictions: evaluations of the control variate. rho_in_sample, std_in_sample: as the paper has them,
    where the method was fitted and judged on all runs too.
    """

    method: str
    mean: float
    std: float
    chebyshev_95: Interval
    chebyshev_99: Interval
    calibrated: Interval
    rho_held_out: float
    n_3d: int
    n_0d: int
    predictions: int
    beta: float
    variance: dict[str, float]
    warnings: list[str]
    rho_in_sample: float | None = None
    std_in_sample: float | None = None


@dataclass(frozen=True)
class Parts:
    """Variance per sample of the parts of a three-level estimate: y − f, f − g and g (see `multilevel_crossfit`)."""

    fine: float
    coarse: float
    cheap: float


@dataclass(frozen=True)
class RowReport:
    """All estimates of one row.

    recommended: the estimator to quote (`estimators.choice`). levels: with a
    coarse 3D level, variances of the parts of the estimator `multilevel`. emulator_error: held-out mean square error
    over variance of the 0D output's emulator. integrated_exactly: the input with a known law that was integrated.
    warnings: of the runs. numerical_correction: added to every 3D output for mesh, time step and cycles; None where
    their error was not measured.
    """

    row: str
    label: str
    column_3d: str
    column_0d: str
    variance_3d: float
    paper: PaperRow
    estimators: dict[str, EstimatorReport]
    recommended: str
    beyond_the_mean: BeyondTheMean
    levels: Parts | None
    n_propagation: int
    emulator_error: float
    integrated_exactly: str | None
    warnings: list[str]
    numerical_correction: float | None = None

    @property
    def recommended_report(self) -> EstimatorReport:
        """The recommended estimator."""
        return self.estimators[self.recommended]

    @property
    def variance_of_states(self) -> float:
        """The variance over states: as estimated along with the quantiles, or else that of the 3D runs alone."""
        estimated = self.beyond_the_mean.variance
        return self.variance_3d if estimated is None else estimated.value

    def warnings_of(self, name: str) -> list[str]:
        """Return the warnings that concern an estimator: its own, and those of the runs unless it is a plain mean."""
        of_runs = self.warnings if name == self.recommended or name != "MC" else []
        return [*of_runs, *self.estimators[name].warnings]


@dataclass(frozen=True)
class LevelWorth:
    """What a coarse 3D level gained for one row; see `level_allocation.worth`."""

    without: str
    std_ratio: float
    gain: float
    optimal_runs_per_fine: float


@dataclass(frozen=True)
class CoarseLevel:
    """Runs and failures of a coarse 3D level, CPU seconds per coarse and per fine run, its worth row by row."""

    runs: int
    failed: int
    coarse_cpu_s: float
    fine_cpu_s: float
    rows: dict[str, LevelWorth]


@dataclass(frozen=True)
class Estimates:
    """`estimates.json`. coarse: None without a coarse 3D level, or where its cost is not known."""

    rows: list[RowReport]
    coarse: CoarseLevel | None
    settings: dict[str, Any]
    provenance: dict[str, Any]


@dataclass(frozen=True)
class Curve:
    """Budget curves of one estimator: variance under the optimal allocation, extra cost (3D runs) per variance."""

    rho: float
    variance_now: float
    optimal_variance: list[float]
    additional_cost: list[float]


@dataclass(frozen=True)
class RowBudget:
    """Budget curves of one row, over budgets in 3D runs and over the target variance as a factor on the present one."""

    row: str
    label: str
    cost_ratio: float
    n_3d: int
    n_0d: int
    budget_3d_runs: list[float]
    variance_factor: list[float]
    estimators: dict[str, Curve]


@dataclass(frozen=True)
class TargetPlan:
    """Target and present half-width of a row's calibrated interval, and what is still needed (costs in 3D runs).

    longer_chain: factor on the length of the posterior's chains, 1 if these are long enough.
    """

    row: str
    target: float
    half_width: float
    more_3d: int
    more_0d: int
    cost: float
    cost_of_half: float
    longer_chain: float = 1.0


@dataclass(frozen=True)
class Budget:
    """`budget.json`."""

    budget: list[RowBudget]
    plan: list[TargetPlan]


@dataclass(frozen=True)
class Counts:
    """Numbers of 3D runs and of 0D runs of the propagation sample, and how long the posterior's chains are for them.

    lengths: first propagation sample and length of the chains that it and later ones are drawn from, by sample; a
    length is that of what follows burn-in over that of the first chains.
    """

    n_3d: int
    n_0d: int
    lengths: tuple[tuple[int, int], ...] = ((0, 1),)

    @classmethod
    def first(cls, counts: Mapping[str, int]) -> "Counts":
        """Return the counts of a first round, `n_3d` and `n_0d`."""
        return cls(counts["n_3d"], counts["n_0d"])

    @property
    def length(self) -> int:
        """Of the chains, over that of the first ones."""
        return self.lengths[-1][1]


@dataclass(frozen=True)
class Bounds:
    """Most 3D runs, 0D runs of the propagation sample, and length of the chains over that of the first ones."""

    n_3d: int
    n_0d: int
    length: int


@dataclass(frozen=True)
class Round:
    """`round_R.json` of a growing campaign.

    why: what ended the campaign (`met`, `bounds reached`, `chain too short`, `rounds exhausted`), or None.
    """

    round: int
    counts: Counts
    plan: list[TargetPlan]
    next: Counts
    done: bool
    why: str | None


@dataclass(frozen=True)
class Convergence:
    """Convergence study of one row at one number of 3D runs: lists with an item per subsample of the pilot."""

    row: str
    label: str
    n_3d: int
    rho_original: list[float]
    mean_mc: list[float]
    rho_crossfit_gp_held_out: list[float]
    rho_ae_in_sample: list[float] | None = None
    rho_ae_held_out: list[float] | None = None


def read_estimates(path: str | Path) -> Estimates:
    """Read `estimates.json`; `InputError` for a file that is not one. The published runs' has no coarse level."""
    return checked(Estimates, {"coarse": None, "provenance": {}} | read_json(path, ("rows",)), path)


def read_budget(path: str | Path) -> Budget:
    """Read `budget.json`; `InputError` for a file that is not one. The published runs' has no plan."""
    return checked(Budget, {"plan": []} | read_json(path, ("budget",)), path)


def read_round(path: str | Path) -> Round:
    """Read the `round_R.json` of a growing campaign; `InputError` for a file that is not one."""
    return checked(Round, read_json(path, ("round",)), path)


def read_convergence(path: str | Path) -> list[Convergence]:
    """Read `convergence.json`; `InputError` for a file that is not one."""
    return checked(list[Convergence], read_json(path, ("convergence",))["convergence"], path)
