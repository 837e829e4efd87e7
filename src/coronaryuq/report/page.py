"""The report of a campaign, `report.html`: one page with its figures, for a cardiologist and an engineer."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import yaml

from coronaryuq.case.case_json import CaseSummary, read_case
from coronaryuq.core import provenance
from coronaryuq.core.io.atomic import read_json, write_text
from coronaryuq.core.io.tables import read_csv
from coronaryuq.estimation.results import RowReport, read_estimates
from coronaryuq.perfusion.targets import PerfusionTargets, read_perfusion_targets
from coronaryuq.posterior.results import Summary, read_summary
from coronaryuq.report import adoption, coarse_level, discrepancy, interval_targets, losses
from coronaryuq.report.costs import costs
from coronaryuq.report.discrepancy import embedded
from coronaryuq.report.error_budget import includes
from coronaryuq.report.mesh_error import MeshError
from coronaryuq.report.numbers import number
from coronaryuq.report.table import Notes, table_row
from coronaryuq.report.vessels import vessel_card

CAPTIONS = {
    "intervals_wss": "Wall shear by estimator: averages over a part of the wall, then the paper's extremes, which have "
    "settled on no mesh tried. Exclamation marks: estimates with a warning.",
    "intervals_ffr": "FFR by estimator, with 0D FFR and with 0D mean flow as the low-fidelity output.",
    "osi_scatter": "3D maximum OSI (an extreme, the paper's example) against 0D mean flow, at the same θ and at the "
    "input paired with it in the shared space. Resampled values come from networks not trained on their sample.",
    "convergence": "Correlation and mean against the number of 3D runs, for maximum OSI (an extreme, the paper's "
    "example); each dot is a random subsample.",
    "budget": "Variance against budget, and cost of a smaller variance.",
    "cardiac_function": "The tuned loop at rest, compared with its targets.",
    "marginals": "Posterior of each outlet's resistance as a multiple of its tuned value r̂: histogram, mean, "
    "95 % interval.",
    "flows": "Simulated outlet flows, compared with the perfusion targets and their noise.",
    "flow_covariance": "Simulated flows of each pair of outlets; the ellipse contains 95 % of the targets' noise.",
    "territories": "Myocardial blood flow and the perfusion territory of each outlet.",
    "tree_ffr": "Mean pressure over mean aortic pressure along the tree, 0D, at the posterior mean.",
    "walls": "Time-averaged wall shear stress and oscillatory shear index of the first 3D sample.",
    "lumen": "Speed and pressure of the first 3D sample, averaged over a cycle, in a plane along each stenosis. Blood "
    "flows from left to right; all panels share the colour scales.",
}
PLACES = {
    "estimates": ("intervals_ffr", "intervals_wss", "budget", "osi_scatter", "convergence"),
    "matched": ("cardiac_function", "flows", "marginals", "flow_covariance"),
    "pictures": ("territories", "tree_ffr", "lumen", "walls"),
}


def write_report(
    files: Mapping[str, str],
    figures: Sequence[str],
    costs_of_jobs: Sequence[str],
    configuration: dict,
    out: str | Path,
    searches: tuple[Sequence[str], ...] = ((), ()),
) -> None:
    """Write the report of a campaign.

    Parameters
    ----------
    files
        Paths of `case`, `fit`, `summary`, `targets`, `failures`, `estimates`, `budget` and `mesh`; also `mesh_study` if
        it was run, `losses_fit` and `losses` if 3D runs taught the 0D model, `adoption` if effects are adopted, and
        `allocation` (of the last round) if the campaign grew.
    figures
        PNG files, named as in `CAPTIONS`.
    costs_of_jobs
        One JSON file per job, see `report.costs.costs`.
    configuration
        The campaign's configuration.
    out
        The page, HTML.
    searches
        Answers, figures and true effects of searches for missing effects; see `report.discrepancy.write_page`.
    """
    case, targets = read_case(files["case"]), read_perfusion_targets(files["targets"])
    summary = read_summary(files["summary"])
    failures, estimates = read_json(files["failures"]), read_estimates(files["estimates"])
    rows = estimates.rows
    notes, mesh = Notes(), MeshError(files["mesh"], files.get("mesh_study"))
    names = _outlet_names(case) | adoption.labels(files)
    context = {
        "case": case,
        "campaign": configuration["name"],
        "backend": configuration["backend"],
        "level": f"{100 * configuration['estimation']['level']:.0f} %",
        "includes": includes([row.recommended_report for row in rows]),
        "low_shear": f"{configuration['flow3d']['low_shear']:g}",
        "counts": _counts(failures, rows, estimates.settings["curve_nodes"]),
        "vessels": [vessel_card(stenosis.name, rows, names, mesh) for stenosis in case.stenoses],
        "table": [table_row(row, notes) | {"mesh": mesh.of(row.column_3d)} for row in rows],
        "notes": notes.texts,
        "coarse_level": coarse_level.sentence(estimates.rows, estimates.coarse),
        "interval_targets": interval_targets.sentences(rows, files["budget"], files.get("allocation")),
        "mesh": mesh.sentence,
        "matched": _matched(read_csv(files["fit"]), summary),
        "losses": losses.learnt(files, [stenosis.name for stenosis in case.stenoses]),
        "noise": _noise(targets),
        "figures": _figures(figures),
        "searches": (found := discrepancy.searches(*searches)),
        "searches_title": discrepancy.title(found),
        "adoption": adoption.adopted(files, invented=bool(found) and all(one["invented"] for one in found)),
        "failed": _failed(failures),
        "costs": costs(costs_of_jobs),
        "provenance": _provenance(estimates.provenance, files),
        "configuration": yaml.safe_dump(configuration, sort_keys=False),
    }
    write_text(out, discrepancy.environment().get_template("template.html").render(context))


def _outlet_names(case: CaseSummary) -> dict[str, str]:
    """Return the label of each input of the posterior."""
    names = {outlet.bc: f"{outlet.label} ({outlet.name})" for outlet in case.outlets}
    return names | {"R_cor_scaling": "total coronary resistance"}


def _counts(failures: dict, rows: list[RowReport], curve_nodes: int) -> dict:
    flow3d, zerod = failures["flow3d"], failures["zerod"]
    trained = [row.estimators["MFMC-AE"] for row in rows if "MFMC-AE" in row.estimators]
    resampled = sum(estimate.n_0d - estimate.n_3d for estimate in trained) + curve_nodes * len(trained)
    propagation = max((row.n_propagation for row in rows), default=0)
    per_3d = failures["cost"]["flow3d_cpu_s"] / max(flow3d["runs"], 1)
    per_0d = failures["cost"]["zerod_cpu_s"] / max(zerod["runs"], 1)
    return {
        "n_3d": flow3d["runs"],
        "n_3d_ok": flow3d["runs"] - len(flow3d["failed"]),
        "n_0d": zerod["runs"] + resampled,
        "n_0d_parts": f"{zerod['runs'] - propagation:,} at the inputs of 3D runs, {propagation:,} for propagation"
        + (f", {resampled:,} for MFMC-AE" if resampled else ""),
        "note": f"Average cost: {per_3d:.1f} CPU-s for a 3D run and {per_0d:.4f} CPU-s for a 0D run, "
        f"a ratio of {per_3d / max(per_0d, 1e-12):.0f}.",
    }


def _matched(fit, summary: Summary) -> dict:
    clinical = fit[fit["clinical"] & fit["tuned"]]
    off = (clinical["simulated"] / clinical["measured"] - 1).abs()
    worst = clinical.loc[off.idxmax(), "description"].lower()
    check, met = summary.predictive, summary.fit.largest_fraction_error
    return {
        "calibration": f"The tuned loop reproduces the {len(clinical)} measured targets to within "
        f"{100 * off.max():.1f} % (largest difference: {worst}).",
        "posterior": f"Chains: {summary.verdict}; largest R-hat {summary.rhat_max:.3f}, smallest bulk effective "
        f"sample size {summary.ess_bulk_min:.0f}, from {summary.model_runs} 0D runs: {summary.effective_per_run:.2f} "
        f"effective samples per run. {_steps(summary)}",
        "predictive": f"{100 * check.coverage_95:.0f} % of the target flows lie in the central 95 % of the posterior "
        f"predictive distribution; the Mahalanobis distance of the mean flows is {check.mahalanobis:.2f} (p = "
        f"{check.p_value:.2f}). The fitted resistances reproduce the "
        f"{len(check.flow_mean)} target fractions to within {100 * met:.2g} %; the posterior mean, which the prior "
        f"shifts, to within {100 * check.largest_fraction_error:.2g} % (posterior/fractions.csv).",
    }


def _steps(summary: Summary) -> str:
    steps = summary.independence
    if not steps.used:
        return f"DREAM without independence steps: {steps.warning}." if steps.warning else ""
    k = "unknown" if steps.k_hat is None else f"{steps.k_hat:.2f}"
    good = "the emulator is good enough for them" if steps.warning is None else steps.warning
    return f"Independence steps: acceptance {100 * summary.acceptance:.1f} %, Pareto k {k} ({good})."


def _noise(targets: PerfusionTargets) -> list[dict]:
    scaled = targets.branch_sd
    used = "covariance" if scaled is None else f"correlations only; sd scaled to {100 * scaled:.0f} %"
    lines = []
    for name, model in targets.models.items():
        correlation = model.correlation
        pairs = correlation[np.triu_indices(len(correlation), 1)]
        spread = 100 * model.relative_sd
        lines.append(
            {
                "name": name,
                "sd": f"{spread.min():.1f} to {spread.max():.1f}",
                "lowest": number(pairs.min(), 2),
                "highest": number(pairs.max(), 2),
                "used": used if name == targets.use else "",
            }
        )
    return lines


def _figures(paths: Sequence[str]) -> dict:
    by_name = {Path(path).stem: path for path in paths}
    return {
        place: [
            {"caption": CAPTIONS[name], "data": embedded(by_name[name])} for name in names if name in by_name
        ]
        for place, names in PLACES.items()
    }  # fmt: skip


def _failed(failures: dict) -> list[dict]:
    stages = (("3D", failures["flow3d"]["failed"]), ("0D", failures["zerod"]["failed"]))
    return [{"sample": f["sample"], "stage": stage, "reason": f["reason"]} for stage, failed in stages for f in failed]


def _provenance(stamp: Mapping[str, object], files: Mapping[str, str]) -> list[tuple[str, str]]:
    lines = [(key, json.dumps(value) if isinstance(value, dict) else str(value)) for key, value in stamp.items()]
    return lines + [(f"SHA-256 of {Path(path).name}", provenance.checksum(path)) for path in files.values()]
