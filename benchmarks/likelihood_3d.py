"""Compare the posterior of a campaign with the one whose every likelihood is a 3D run.

A campaign's posterior is sampled with 0D flows. Its 3D runs are made at samples of that posterior; where the mesh
reaches every bed (`mesh.domain: trees`) they give the flows whose likelihood 0D approximated. The ratio of both
likelihoods turns the samples into some of the posterior by 3D, exactly but for their number (importance sampling with
Pareto-smoothed weights). Printed as JSON: Pareto k, how many of the samples remain effective, mean flows of 3D over
those of 0D, and FFR by 3D under both posteriors, with the standard error of the difference of the means.

For the numbers in docs/explanation/losses.md, with trees.yaml:

    name: trees
    uncertainty: full
    samples: {n_3d: 48}
    mesh: {domain: trees}
    losses: {runs_3d: 8}

    snakemake --configfile config/smoke.yaml trees.yaml -- results/trees/runs/outputs_3d.csv
    python benchmarks/likelihood_3d.py results/trees
"""

import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.core.importance_weights import pareto_smoothed
from coronaryuq.posterior.model.likelihood import Likelihood, likelihood_of
from coronaryuq.posterior.reading import Reading
from coronaryuq.posterior.results import Chains
from coronaryuq.zerod.network.beds import SCALING

LEVELS = (0.05, 0.5, 0.95)


def compared(results: Path) -> dict:
    """Return the comparison for a results folder."""
    chains = Chains.read(results / "posterior" / "length_1" / "chains.npz")
    simple, full = (pd.read_csv(results / "runs" / f"outputs_{name}.csv").set_index("sample") for name in ("0d", "3d"))
    samples = simple.index.intersection(full.index)
    simple, full = simple.loc[samples], full.loc[samples]
    columns = [_flow_into(bed, full.columns) for bed in chains.names]
    flows_0d, flows_3d = (table[columns].to_numpy() for table in (simple, full))
    ffr = full[[column for column in full.columns if column.startswith("ffr_")]]
    ratio = flows_3d / flows_0d
    flow = dict(zip(chains.names, map(float, ratio.mean(axis=0)), strict=True))
    theta = pd.read_csv(results / "samples" / "pilot.csv").set_index("sample").loc[samples]
    multipliers = theta[chains.names].to_numpy() * theta[[SCALING]].to_numpy()
    over_flow = Reading(chains.reading_gain, chains.reading_centre).over_flow(multipliers)
    flows_0d, flows_3d = flows_0d * over_flow, flows_3d * over_flow
    found = {"mean_flow_3d_over_0d": flow, "largest_flow_difference": float(np.abs(ratio - 1.0).max())}
    return found | reweighted(likelihood_of(chains), flows_0d, flows_3d, ffr)


def reweighted(likelihood: Likelihood, flows_0d: np.ndarray, flows_3d: np.ndarray, ffr: pd.DataFrame) -> dict:
    """Return how the posterior changes if the flows (n, N) of 3D take the place of those of 0D in the likelihood.

    ffr: of the same samples by 3D, a column for each stenosis.
    """
    log_ratio = likelihood.log_density(flows_3d) - likelihood.log_density(flows_0d)
    k_hat, weights = pareto_smoothed(log_ratio)
    return {
        "samples": len(weights),
        "pareto_k": k_hat,
        "effective_share": float(1.0 / (len(weights) * np.sum(weights**2))),
        "log_ratio_sd": float(np.std(log_ratio, ddof=1)),
        "ffr": {name: _ffr(column.to_numpy(), weights) for name, column in ffr.items()},
    }


def _flow_into(bed: str, columns: pd.Index) -> str:
    found = [column for column in columns if column.startswith("mean_flow:") and column.endswith(f":{bed}")]
    if len(found) != 1:
        sys.exit(f"the 3D runs do not give the flow into {bed}; set mesh.domain: trees")
    return found[0]


def _ffr(ffr: np.ndarray, weights: np.ndarray) -> dict:
    equal = np.full(len(ffr), 1.0 / len(ffr))
    shift = np.sum((weights - equal) * ffr)
    error = np.sqrt(np.sum((weights - equal) ** 2 * (ffr - np.sum(weights * ffr)) ** 2))
    return {
        "0d_likelihood": _quantiles(ffr, equal),
        "3d_likelihood": _quantiles(ffr, weights),
        "difference_of_means": float(shift),
        "its_standard_error": float(error),
    }


def _quantiles(values: np.ndarray, weights: np.ndarray) -> dict:
    order = np.argsort(values)
    cumulative = np.cumsum(weights[order]) - 0.5 * weights[order]
    found = np.interp(LEVELS, cumulative, values[order])
    return {f"{level:g}": float(value) for level, value in zip(LEVELS, found, strict=True)}


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    print(json.dumps(compared(Path(sys.argv[1])), indent=1))
