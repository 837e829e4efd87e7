"""A whole campaign on a patient's case, as Snakemake runs it, and what it says about every stenosis."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from coronaryuq import config
from coronaryuq.bench.campaign import snakemake
from coronaryuq.bench.endtoend.data import BED_NOISE
from coronaryuq.bench.endtoend.score import FFR, LIMIT
from coronaryuq.case.settings import Uncertainty
from coronaryuq.core.io.atomic import read_json, write_text
from coronaryuq.estimation.results import RowReport, read_estimates
from coronaryuq.losses.settings import Settings as LossesSettings

NAME = "patient"
ESTIMATES, POSTERIOR = "estimation/estimates.json", "posterior/summary.json"
ROWS = ("ffr_ffr", "tawss_patch_flow", "osi_patch_flow")
"""Rows that are estimated of every stenosis: FFR, wall shear and oscillation averaged over patches of 1 mm."""
LEAST_NOISE = 0.01
"""Relative standard deviation of a bed's perfusion that a campaign is told at least, and the least factor on the range
of the total resistance."""
FIXED: dict[str, dict[str, Any]] = {
    "estimation": {"autoencoder": False, "ffr_zones": [0.75, LIMIT]},
    "flow3d": {"fields": 0},
}
"""Settings that change no interval of the recommended estimator but cost less, and the limit that is scored."""
LOSSES: dict[Uncertainty, LossesSettings] = {"full": LossesSettings(), "paper": LossesSettings(runs_3d=0)}
"""Losses of the 0D vessels: as campaigns have them by default, and as in the paper. `smoke` leaves them out."""


@dataclass(frozen=True)
class Said:
    """What a campaign says.

    vessels: stenosis → quantity → `quantiles`, those that are stated, and, for FFR, `below`, P(FFR ≤ 0.80), and
    `method`. rhat_max, ess_bulk_min, converged: of its posterior.
    """

    vessels: dict[str, dict[str, dict[str, Any]]]
    rhat_max: float
    ess_bulk_min: float
    converged: bool
    cpu_s: float


def run_campaign(
    case: Path,
    lesions: Sequence[str],
    configuration: Path,
    uncertainty: Uncertainty,
    seed: int,
    noise: float,
    cores: int,
    folder: Path,
) -> Said:
    """Run the campaign of a case up to its estimates.

    Parameters
    ----------
    case
        `case.yaml`.
    lesions
        Names of its stenoses.
    configuration
        Settings of the campaign; patient, seed, `uncertainty`, losses and the perfusion noise are set here.
    uncertainty
        `full` or `paper`.
    seed
        Of the campaign.
    noise
        Factor on the perfusion noise that the campaign is told and, up to 1, on the range of the total resistance.
    cores, folder
        Cores, and where it runs.

    Raises
    ------
    RuntimeError
        If a job of the campaign fails.
    """
    settings = config.load(configuration).model_dump(mode="json")
    for block, values in FIXED.items():
        settings[block] |= values
    settings["perfusion"]["branch_sd"] = max(BED_NOISE * noise, LEAST_NOISE)
    low, high = settings["posterior"]["scaling"]
    width = max(min(noise, 1.0), LEAST_NOISE)
    settings["posterior"]["scaling"] = [1.0 - width * (1.0 - low), 1.0 + width * (high - 1.0)]
    settings["estimation"]["rows"] = [f"{row}_{lesion.lower()}" for lesion in lesions for row in ROWS]
    settings |= {
        "name": NAME, "case": case.resolve().as_posix(), "uncertainty": uncertainty, "seed": seed,
        "losses": LOSSES[uncertainty].model_dump(mode="json"),
    }  # fmt: skip
    written = folder / "campaign.yaml"
    write_text(written, yaml.safe_dump(settings, sort_keys=False))
    results = Path("results", NAME)
    targets = [(results / name).as_posix() for name in (ESTIMATES, POSTERIOR)]
    done = snakemake(written, str(folder), "--cores", str(cores), "--", *targets)
    return said(folder / results, done.cpu_s)


def said(results: Path, cpu_s: float) -> Said:
    """Read what a campaign says from its results folder."""
    posterior = read_json(results / POSTERIOR, ("rhat_max",))
    vessels: dict[str, dict[str, dict[str, Any]]] = {}
    rows = read_estimates(results / ESTIMATES).rows
    for column in dict.fromkeys(row.column_3d for row in rows):
        row = min((row for row in rows if row.column_3d == column), key=lambda row: row.recommended_report.std)
        quantity, _, vessel = column.rpartition("_")
        if row.beyond_the_mean.predictive:
            vessels.setdefault(vessel, {})[quantity] = _answer(row, quantity)
    diagnosis = {name: posterior[name] for name in ("rhat_max", "ess_bulk_min", "converged")}
    return Said(vessels, **diagnosis, cpu_s=cpu_s)


def _answer(row: RowReport, quantity: str) -> dict[str, Any]:
    beyond = row.beyond_the_mean
    answer: dict[str, Any] = {
        "quantiles": dict(beyond.predictive or {}),
        "method": row.recommended,
    }
    if quantity == FFR and beyond.zones:
        answer["below"] = beyond.zones[-1].complement.value
    return answer
