"""Inputs of the 3D runs that teach the 0D model its losses; apart, so that an edit of the fit repeats no 3D run."""

from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.case.case_json import read_case
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.seeds import generator
from coronaryuq.perfusion.targets import read_perfusion_targets
from coronaryuq.posterior.model.bed_flows import BedFlows
from coronaryuq.posterior.model.fit_to_fractions import fit_fractions
from coronaryuq.posterior.settings import Settings as PosteriorSettings
from coronaryuq.zerod.network.beds import SCALING


def teaching_inputs(
    case_json: str | Path, hyperaemia_json: str | Path, targets_json: str | Path, settings: PosteriorSettings,
    seed: int, number: int, samples_csv: str | Path,
) -> None:  # fmt: skip
    """Write inputs θ that are spread like those of the posterior, without sampling it.

    Target flows are drawn from the noise of the perfusion map, and the resistances are those by which the loop meets
    their fractions; `R_cor_scaling` is drawn as for all samples.

    Parameters
    ----------
    case_json, hyperaemia_json, targets_json
        The case, its tuned loop under hyperaemia, and the perfusion stage's target flows.
    settings, seed
        Settings of the posterior and the campaign's seed.
    number
        Number of samples.
    samples_csv
        Table to write: `sample`, one multiplier per bed, `R_cor_scaling`.
    """
    targets, case = read_perfusion_targets(targets_json), read_case(case_json)
    vessels = {outlet.bc: outlet.vessel for outlet in case.outlets if outlet.bc in targets.bc}
    model = BedFlows(
        hyperaemia_json, {bc: vessels[bc] for bc in targets.bc}, tolerance=settings.cycle_tolerance,
        steps_per_cycle=settings.steps_per_cycle,
    )  # fmt: skip
    rows = []
    for k in range(number):
        random = generator(seed, "losses", "inputs", k)
        flows = random.multivariate_normal(targets.mean, targets.covariance, method="cholesky")
        # A flow that noise makes zero or negative has no resistance.
        flows = np.maximum(flows, 0.1 * targets.mean)
        multipliers = fit_fractions(model.flows, model.weights, flows).multipliers
        rows.append([f"losses_{k:05d}", *multipliers, random.uniform(*settings.scaling)])
    write_csv(samples_csv, pd.DataFrame(rows, columns=["sample", *targets.bc, SCALING]))
