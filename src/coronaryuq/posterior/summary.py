"""What the chains give: a DataTree for ArviZ, a table of thinned draws, and the summary."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from coronaryuq.core.importance_weights import good_enough, pareto_smoothed
from coronaryuq.core.io.atomic import replacing
from coronaryuq.core.seeds import generator
from coronaryuq.posterior.model.likelihood import likelihood_of
from coronaryuq.posterior.model.predictive import check
from coronaryuq.posterior.results import (
    Chains,
    EmulatorUse,
    FitToFractions,
    IndependenceUse,
    Marginal,
    ReferenceShares,
    Summary,
)
from coronaryuq.posterior.sampler.diagnostics import diagnose
from coronaryuq.posterior.settings import Settings
from coronaryuq.zerod.network.beds import SCALING

if TYPE_CHECKING:
    import pandas as pd


def write_inference_data(chains: Chains, posterior_nc: str | Path) -> None:
    """Write the states after burn-in as the DataTree that ArviZ reads (netCDF)."""
    import arviz_base

    posterior = {"r": chains.kept_multipliers, "flow": chains.kept_flows}
    coords, dims = {"bed": chains.names}, {"r": ["bed"], "flow": ["bed"], "target_flow": ["bed"]}
    if chains.parameter_names:
        posterior["parameter_value"] = chains.kept_parameters
        coords["parameter"], dims["parameter_value"] = chains.parameter_names, ["parameter"]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="More chains")
        data = arviz_base.from_dict(
            {
                "posterior": posterior,
                "sample_stats": {"lp": chains.kept_log_density},
                "observed_data": {"target_flow": chains.target_mean},
            },
            coords=coords,
            dims=dims,
        )
    for group in data.subtree:
        group.attrs.pop("created_at", None)  # equal posteriors are equal files
    size = sum(group.nbytes for group in data.subtree)
    with replacing(posterior_nc, room=size + 2**17) as beside:  # HDF5 loses the error on a full disk
        data.to_netcdf(str(beside), engine="h5netcdf")


def table_of_draws(chains: Chains, most: int) -> "pd.DataFrame":
    """Return thinned draws: chain, generation, one multiplier per bed, uncertain parameters, log_density.

    At most `most` of each part as long as the first chains: the table of longer chains begins with that of shorter
    ones, and every part has as many rows.
    """
    import pandas as pd

    values = np.concatenate([chains.kept_multipliers, chains.kept_parameters], axis=2)
    n, kept, columns = values.shape
    part = n * kept // chains.length
    stride = max(1, -(-part // most))
    chosen = (part * np.arange(chains.length)[:, None] + np.arange(0, part, stride)).reshape(-1)
    names = [*chains.names, *chains.parameter_names]
    table = pd.DataFrame(values.transpose(1, 0, 2).reshape(-1, columns)[chosen], columns=names)
    table.insert(0, "chain", chosen % n)
    table.insert(1, "generation", (chosen // n + chains.burn_in + 1) * chains.every)
    table["log_density"] = chains.kept_log_density.T.reshape(-1)[chosen]
    return table


def summarise(
    chains: Chains, settings: Settings, seed: int, draws: int, r_hat: ReferenceShares, provenance: dict[str, Any]
) -> Summary:
    """Return verdict, marginals, fit and predictive checks; draws: rows of the table of draws."""
    names, multipliers, extra = chains.names, chains.kept_multipliers, chains.parameter_names
    drawn = np.concatenate([multipliers, chains.kept_parameters], axis=2)
    flat, quantiles = drawn.reshape(-1, len(names) + len(extra)), (0.025, 0.5, 0.975)
    fitted, inferred_total = by_name(names, chains.fit_multipliers), SCALING in extra
    # A parameter without spread is no unknown.
    moving = np.concatenate([np.ones(len(names), dtype=bool), np.ptp(chains.kept_parameters, axis=(0, 1)) > 0])
    unknown = [name for name, moves in zip([*names, *extra], moving, strict=True) if moves]
    diagnosis = diagnose(drawn[:, :, moving], unknown, settings.rhat_limit, settings.ess_limit)
    marginals = {
        name: Marginal(m.mean(), m.std(ddof=1), *q)
        for name, m, q in zip([*names, *extra], flat.T, np.quantile(flat, quantiles, axis=0).T, strict=True)
    }
    return Summary(
        **vars(diagnosis),
        chains=len(multipliers),
        generations=chains.generations,
        recorded_per_chain=multipliers.shape[1],
        draws=draws,
        acceptance=float(np.mean(chains.accepted) / chains.proposed),
        emulator=EmulatorUse(
            used=chains.emulated,
            generations_per_decision=chains.every,
            acceptance=float(np.mean(chains.screen_accepted) / chains.screen_proposed) if chains.emulated else None,
            error_of_log_flow=chains.emulator_error.tolist(),
        ),
        independence=_independence(chains, settings.independence.k_limit),
        model_runs=chains.runs,
        effective_per_run=diagnosis.ess_bulk_min / chains.runs,
        failed_runs=chains.failures,
        outlier_chains_restarted=chains.outliers,
        crossover_probabilities=chains.crossover.tolist(),
        constraint="per gram" if inferred_total else settings.constraint,
        target_scale=chains.target_scale,
        fit=FitToFractions(
            multipliers=fitted,
            flows=by_name(names, chains.fit_flows),
            largest_fraction_error=chains.fit_error,
            outside_prior=[name for name, lies in zip(names, chains.fit_outside.tolist(), strict=True) if lies],
        ),
        prior_ranges={name: (low, high) for name, (low, high) in by_name(names, chains.prior_ranges).items()},
        multipliers={name: marginals[name] for name in names},
        parameters={name: marginals[name] for name in extra},
        most_probable_draw=by_name([*names, *extra], flat[np.argmax(chains.kept_log_density)]),
        predictive=check(
            chains.kept_readings.reshape(-1, len(names)),
            likelihood_of(chains),
            names,
            generator(seed, "posterior", "predictive"),
            total_free=inferred_total,
        ),  # fmt: skip
        r_hat=r_hat,
        provenance=provenance,
    )


def _independence(chains: Chains, limit: float) -> IndependenceUse:
    k_hat, weights = pareto_smoothed(chains.log_weight.reshape(-1)) if chains.emulated else (np.nan, np.ones(1))
    told = [chains.refused] if chains.refused else []
    if chains.emulated and not good_enough(k_hat, weights, limit):
        told.append(
            f"Pareto k of the ratios of 0D model to emulator is {k_hat:.2f}, should be below {limit}: effective sample "
            "sizes may be overstated; compare with emulator.use: false"
        )
    pilot, whole = (float(k) if np.isfinite(k) else None for k in (chains.pilot_k_hat, k_hat))
    return IndependenceUse(chains.independent, pilot, whole, "; ".join(told) or None)


def by_name(names: list[str], values: np.ndarray) -> dict[str, Any]:
    """Return {name: value}."""
    return dict(zip(names, values.tolist(), strict=True))
