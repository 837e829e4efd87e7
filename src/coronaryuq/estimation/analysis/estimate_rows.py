"""Every estimate of every row of one set of runs; the stage and the benchmarks call this."""

from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from coronaryuq.estimation import training
from coronaryuq.estimation.analysis import diagnostics, failures
from coronaryuq.estimation.analysis.paper import paper_row
from coronaryuq.estimation.analysis.tables import estimator_report
from coronaryuq.estimation.estimators import multilevel_crossfit, per_row
from coronaryuq.estimation.estimators.beyond_the_mean import beyond_the_mean
from coronaryuq.estimation.estimators.choice import TESTED, recommended
from coronaryuq.estimation.estimators.crossfit import Estimate
from coronaryuq.estimation.estimators.design import Design, make_design
from coronaryuq.estimation.estimators.folds import count
from coronaryuq.estimation.estimators.formulas import mfmc_variance
from coronaryuq.estimation.estimators.per_row import Curves
from coronaryuq.estimation.results import BeyondTheMean, Parts, RowReport
from coronaryuq.estimation.runs.table import Row, Runs, pair
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates import mfmc_ae

EMULATOR_SHARE = 1e-2
ORDER = ("MC", "MFMC", "MFMC-AE", "BLUE", "crossfit-GP", "multilevel")
"""Of the estimators in `estimates.json`, the table and the figures."""


def curves_of(networks: mfmc_ae.Networks, row: Row, outputs: pd.Series, nodes: int) -> Curves:
    """Curves of one row; failed 0D runs are left out of a curve, and there are none if one has fewer than 3 runs."""
    curves = {}
    for k in [*range(networks.folds), mfmc_ae.IN_SAMPLE]:
        places = mfmc_ae.nodes(networks, row.name, k, nodes)
        values = outputs.reindex([training.sample_name(row.name, k, i) for i in range(len(places))]).to_numpy(float)
        finite = np.isfinite(values)
        if finite.sum() < 3:
            return {}
        curves[k] = (places[finite], values[finite])
    return curves


def analyse(
    runs: Runs, rows: list[Row], settings: Settings, seed: int,
    networks: mfmc_ae.Networks | None = None, resampled: pd.DataFrame | None = None, design: Design | None = None,
    beyond_mean: bool = True,
) -> list[RowReport]:  # fmt: skip
    """Estimate every row of one set of runs.

    Parameters
    ----------
    runs, rows
        The runs, and the pairs of a 3D and a 0D output to estimate.
    settings, seed
        Settings of the stage and seed of folds and blocks.
    networks, resampled
        Networks of MFMC-AE and 0D outputs at the inputs of `resampled_inputs`, index `sample`; without them there is no
        MFMC-AE.
    design
        Folds and emulated 0D outputs, where they are known already.
    beyond_mean
        Also estimate quantiles, probabilities, variance and Sobol indices.

    Raises
    ------
    InputError
        If there are too few runs, or if a row names a column that does not exist.
    """
    training.check_number_of_runs(runs, settings)
    design = design or make_design(runs, rows, count(len(runs), settings.folds), seed, settings.known_scaling)
    methods, findings = prepare(design, settings, seed, networks, resampled, beyond_mean)
    return [estimate_row(row, methods, findings) for row in rows]


def prepare(
    design: Design, settings: Settings, seed: int, networks: mfmc_ae.Networks | None = None,
    resampled: pd.DataFrame | None = None, beyond_mean: bool = True,
) -> tuple["Methods", tuple[diagnostics.Finding, ...]]:  # fmt: skip
    """Check the runs of a design; return what the estimators of all rows share, and warnings that hold for all rows.

    Parameters as in `analyse`.
    """
    runs = design.runs
    failed = failures.failed_not_at_random(runs, seed, settings.known_scaling)
    unequal = tuple(f for f in (diagnostics.different_inputs(runs, design.dependence), failed) if f)
    weights = diagnostics.balancing_weights(runs) if unequal else None
    dependent = diagnostics.dependent(design.dependence)
    if weights is not None:
        design = replace(design, dependence=replace(design.dependence, shared=True))
    findings = unequal if dependent is None else (*unequal, dependent)
    lost = failures.failed_propagation(runs, seed, settings.known_scaling)
    findings += () if lost is None else (lost,)
    return Methods(design, settings, seed, weights, networks, resampled, beyond_mean), findings


@dataclass
class Methods:
    """What the estimators of all rows share. Rows of one 3D output share its `crossfit-GP` and `multilevel`, too.

    weights (n,): of the pilot runs, mean one, where the pilot is not distributed as the propagation samples; else None.
    """

    design: Design
    settings: Settings
    seed: int
    weights: np.ndarray | None
    networks: mfmc_ae.Networks | None
    resampled: pd.DataFrame | None
    beyond_mean: bool
    _crossfit_gp: dict[str, tuple[Estimate, BeyondTheMean]] = field(default_factory=dict)
    _levels: dict[str, tuple[Estimate, Parts] | None] = field(default_factory=dict)

    def crossfit_gp(self, row: Row) -> tuple[Estimate, BeyondTheMean]:
        if row.column_3d not in self._crossfit_gp:
            predictions = per_row.predict(self.design, row)
            beyond = self.beyond_mean and np.ptp(pair(self.design.runs, row)[0]) > 0
            self._crossfit_gp[row.column_3d] = (
                per_row.crossfit_gp(self.design, row, predictions, self.settings.level, self.weights),
                beyond_the_mean(self.design, row, predictions, self.settings) if beyond else BeyondTheMean(),
            )
        return self._crossfit_gp[row.column_3d]

    def autoencoder(self, row: Row) -> Estimate | None:
        """MFMC-AE with the paper's in-sample numbers; None without networks, or where too many 0D runs failed."""
        if self.networks is None or self.resampled is None or row.name not in self.networks.rows:
            return None
        design, networks, runs = self.design, self.networks, self.design.runs
        curves = curves_of(networks, row, self.resampled[row.column_0d], self.settings.curve_nodes)
        if not curves:
            return None
        y, _ = pair(runs, row)
        rho = per_row.autoencoder_in_sample(design, row, networks, curves)
        variance = mfmc_variance(np.var(y), rho, len(y), len(y) + len(runs.theta_more))
        estimate = per_row.autoencoder(design, row, networks, curves, self.settings.level, self.weights)
        folds = range(len(design.blocks))
        theta = np.vstack([mfmc_ae.resampled(networks, row.name, k, curves[k][0]) for k in folds])
        estimate = estimate.warned(diagnostics.outside_support(theta, runs.theta, runs.inputs))
        return replace(estimate, rho_in_sample=rho, std_in_sample=float(variance**0.5))

    def multilevel(self, row: Row) -> tuple[Estimate, Parts] | None:
        if row.column_3d not in self._levels:
            self._levels[row.column_3d] = multilevel_crossfit.multilevel(self.design, row, self.settings.level)
        return self._levels[row.column_3d]


def estimate_row(row: Row, methods: Methods, findings: tuple[diagnostics.Finding, ...]) -> RowReport:
    """Estimate one row by every method; findings: warnings that hold for all rows."""
    design, settings, runs = methods.design, methods.settings, methods.design.runs
    y, q = pair(runs, row)
    made, parts = estimates_of(row, methods)
    crossfit_gp, beyond = methods.crossfit_gp(row)
    varies = np.ptp(y) > 0
    chosen = recommended(made) if varies else "MC"
    found = (
        row.warning,
        *findings,
        diagnostics.unseen(len(y)) if varies else None,
        diagnostics.constant(y),
        diagnostics.dominated(crossfit_gp.residuals, runs.samples),
        diagnostics.disagreement({name: made[name] for name in TESTED if name in made}, chosen) if varies else None,
    )
    return RowReport(
        row=row.name, label=row.label, column_3d=row.column_3d, column_0d=row.column_0d,
        variance_3d=float(np.var(y, ddof=1)),
        paper=paper_row(y, q, max(len(runs.theta_more), len(y))),  # the paper counts the pilot into its N_0D
        estimators={name: estimator_report(estimate) for name, estimate in made.items()},
        recommended=chosen,
        beyond_the_mean=beyond,
        levels=parts,
        n_propagation=len(runs.theta_more),
        emulator_error=design.emulator_error[row.column_0d],
        integrated_exactly=settings.known_scaling if design.integrated else None,
        warnings=[str(finding) for finding in found if finding],
    )  # fmt: skip


def estimates_of(row: Row, methods: Methods) -> tuple[dict[str, Estimate], Parts | None]:
    """Return every method's estimate of one row, and the variances of the parts of `multilevel`."""
    design, settings, runs, weights = methods.design, methods.settings, methods.design.runs, methods.weights
    y, _ = pair(runs, row)
    estimates: dict[str, Estimate | None] = {
        "MC": per_row.monte_carlo(design, row, settings.level, weights),
        "MFMC": per_row.mfmc(design, row, settings.level, weights),
        "MFMC-AE": methods.autoencoder(row),
        "crossfit-GP": methods.crossfit_gp(row)[0],
    }
    parts = None
    if weights is None:
        # Pilot runs that are reweighted to the propagation inputs would need weights on a coarse level too.
        estimates["BLUE"] = per_row.several_models(design, row, methods.seed, settings.level)
        levels = methods.multilevel(row)
        if levels is not None:
            parts = levels[1]
            estimates["multilevel"] = _warned(levels[0], diagnostics.coarse_failures(runs))
    made = {name: _judged(name, estimate, y) for name in ORDER if (estimate := estimates.get(name)) is not None}
    error = design.emulator_error[row.column_0d]
    if error > EMULATOR_SHARE:
        made["MFMC"] = _warned(made["MFMC"], diagnostics.unexplained(row.column_0d, error))
    return made, parts


def _judged(name: str, estimate: Estimate, y: np.ndarray) -> Estimate:
    """Add the warnings that concern the method to the estimate; where y (n,) does not vary, no method can gain."""
    judged = name != "MC" and np.ptp(y) > 0
    gain = diagnostics.without_gain(estimate.rho_held_out, len(y), name) if judged else None
    return _warned(_warned(estimate, diagnostics.skewed(estimate)), gain)


def _warned(estimate: Estimate, finding: diagnostics.Finding | None) -> Estimate:
    return estimate if finding is None else estimate.warned(finding, finding.blocks)
