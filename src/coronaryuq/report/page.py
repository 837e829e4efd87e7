"""The report of a campaign, `report.html`: one page for a physician, an engineer and a statistician."""

import json
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path

import numpy as np
import yaml

from coronaryuq.case.anatomy.dominance import WORDS
from coronaryuq.case.case_json import CaseStenosis, CaseSummary, read_case
from coronaryuq.case.network.network_names import InWords
from coronaryuq.core import provenance
from coronaryuq.core.io.atomic import read_json, write_text
from coronaryuq.core.io.tables import read_csv
from coronaryuq.estimation.results import EstimatorReport, RowReport, read_estimates
from coronaryuq.flow3d.mesh.description import MeshDescription, read_description
from coronaryuq.perfusion.targets import PerfusionTargets, read_perfusion_targets
from coronaryuq.posterior.results import Summary, read_summary
from coronaryuq.report import adoption, coarse_level, discrepancy, interval_targets, losses, methods, predicted, tree
from coronaryuq.report.alt_texts import alternatives
from coronaryuq.report.costs import costs
from coronaryuq.report.embedding import FIRST, data_url, figures_of_sections, unbroken
from coronaryuq.report.error_budget import ASSUMED, includes
from coronaryuq.report.input_names import input_names
from coronaryuq.report.lesions import Lesion, lesion_card
from coronaryuq.report.mesh_error import MeshError
from coronaryuq.report.numbers import number
from coronaryuq.report.quantities import kind_of
from coronaryuq.report.runs3d import quality
from coronaryuq.report.table import Notes, table_lines


def write_report(
    files: Mapping[str, str],
    figures: Sequence[str],
    costs_of_jobs: Sequence[str],
    configuration: dict,
    out: str | Path,
    searches: tuple[Sequence[str], ...] = ((), ()),
    records: Sequence[str] = (),
) -> None:
    """Write the report of a campaign.

    Parameters
    ----------
    files
        Paths of `case`, `tree`, `pressures`, `predicted`, `fit`, `summary`, `targets`, `failures`, `estimates`,
        `table`, `budget` and `mesh`; also `lv` where the patient has a perfusion map, `mesh_study` if it was run,
        `losses_fit` and `losses` if 3D runs taught the 0D model, `adoption` if effects are adopted, and `allocation`
        (of the last round) if the campaign grew.
    figures
        PNG and SVG files, named as in `captions.CAPTIONS`.
    costs_of_jobs
        One JSON file per job, see `report.costs.costs`.
    configuration
        The campaign's configuration.
    out
        The page, HTML.
    searches
        Answers, figures and true effects of searches for missing effects; see `report.discrepancy.write_page`.
    records
        Records of the 3D runs, one file per batch.
    """
    case, targets = read_case(files["case"]), read_perfusion_targets(files["targets"])
    summary, mesh_json = read_summary(files["summary"]), read_description(files["mesh"])
    failures, estimates = read_json(files["failures"]), read_estimates(files["estimates"])
    rows = estimates.rows
    assumed = any(ASSUMED in row.recommended_report.variance for row in rows)
    notes, mesh = Notes(_names(case, rows)), MeshError(files["mesh"], files.get("mesh_study"), assumed)
    readings = tree.Readings.read(case, files["tree"], files["pressures"])
    asked = predicted.read_predicted(files["predicted"])
    lowest = predicted.lowest(asked, readings)
    counts = _counts(failures, rows, estimates.settings["curve_nodes"], summary.model_runs)
    inputs = input_names(case) | adoption.labels(files)
    lesions = [Lesion(one, inputs, mesh, _beyond(one, mesh_json), _past(one, mesh_json)) for one in case.stenoses]
    texts = alternatives(rows, lowest, summary, _names(case, rows))
    drawn = figures_of_sections(figures, texts, others={"fit": len(searches[1])})
    # Searches come after the fit to the data.
    in_words = InWords.of(readings.tree, case.outlets, case.stenoses, case.systemic)
    found = discrepancy.searches(*searches, first_figure=FIRST + len(drawn["pictures"]) + len(drawn["fit"]))
    context = {
        "case": case,
        "dominance": case.dominance and WORDS[case.dominance],
        "date": f"{date.today():%d %B %Y}".lstrip("0"),
        "campaign": configuration["name"],
        "backend": configuration["backend"],
        "level": f"{100 * configuration['estimation']['level']:.0f} %",
        "includes": includes([row.recommended_report for row in rows]),
        "low_shear": f"{configuration['flow3d']['low_shear']:g}",
        "counts": counts,
        "lesions": [lesion_card(lesion, rows) for lesion in lesions],
        "lowest": lowest,
        "predicted": predicted.lines(asked, readings),
        "scene": tree.scene(readings, case, mesh_json.planes, files.get("lv")),
        "table": [
            line
            for row in rows
            for line in table_lines(row, rows, mesh.of(row.column_3d, kind_of(row.column_3d).scale), notes)
        ],
        "notes": notes.groups,
        "coarse_level": coarse_level.sentence(estimates.rows, estimates.coarse),
        "interval_targets": interval_targets.sentences(rows, files["budget"], files.get("allocation")),
        "mesh": mesh.sentence,
        "runs3d": quality(records, configuration["flow3d"]["tolerance"]),
        "fit": _fit(read_csv(files["fit"]), summary),
        "chains": _chains(summary, configuration["posterior"]),
        "losses": losses.learnt(files, [stenosis.name for stenosis in case.stenoses], in_words),
        "noise": _noise(targets),
        "figures": drawn,
        "searches": in_words(found),
        "searches_title": discrepancy.title(found),
        "adoption": adoption.adopted(files, invented=bool(found) and all(one["invented"] for one in found)),
        "failed": _failed(failures),
        "costs": costs(costs_of_jobs),
        "provenance": _provenance(estimates.provenance, files),
        "configuration": yaml.safe_dump(configuration, sort_keys=False),
        "methods": methods.paragraph(case, configuration, counts, summary, mesh_json.nodes, estimates.provenance),
        "bibtex": f"{methods.REFERENCES}\n{methods.software(estimates.provenance)}",
        "downloads": [
            {"name": name, "data": data_url(files[key], "text/csv")}
            for name, key in (
                ("estimates.csv", "table"),
                ("predicted.csv", "predicted"),
                ("pressures.csv", "pressures"),
                ("calibration.csv", "fit"),
            )
        ],
    }
    write_text(out, unbroken(discrepancy.environment().get_template("template.html").render(context)))


def _names(case: CaseSummary, rows: list[RowReport]) -> dict[str, str]:
    """Return what a reader calls the inputs and the 3D and 0D quantities."""
    quantities = {f"ffr_{stenosis.name.lower()}": f"FFR {stenosis.name}" for stenosis in case.stenoses}
    quantities |= {row.column_3d: f"{kind_of(row.column_3d).name} {row.label.split(', ')[-1]}" for row in rows}
    return {outlet.bc: outlet.label for outlet in case.outlets} | _names_0d(rows) | quantities


def _names_0d(rows: list[RowReport]) -> dict[str, str]:
    """Return what a reader calls the 0D quantities: a row's label holds 3D quantity, 0D quantity and artery."""
    return {row.column_0d: " ".join(row.label.split(", ")[1:]) or row.column_0d for row in rows}


def _beyond(stenosis, mesh: MeshDescription) -> float | None:
    """Return the distance (cm) from the end of a lesion to the plane at which its FFR is read; None without one."""
    plane, region = mesh.planes.get(stenosis.name), mesh.regions.get(stenosis.name)
    if plane is None or region is None or stenosis.end is None:
        return None
    return plane.distance_from_throat - (stenosis.end - region.throat)


def _past(stenosis: CaseStenosis, mesh: MeshDescription) -> bool:
    """Return whether FFR of a lesion is read in another vessel than the lesion's, beyond a branching."""
    plane = mesh.planes.get(stenosis.name)
    return plane is not None and plane.vessel != stenosis.vessel


def _counts(failures: dict, rows: list[RowReport], curve_nodes: int, posterior_runs: int) -> dict:
    flow3d, zerod = failures["flow3d"], failures["zerod"]
    trained = [row.estimators["MFMC-AE"] for row in rows if "MFMC-AE" in row.estimators]
    resampled = sum(estimate.n_0d - estimate.n_3d for estimate in trained) + curve_nodes * len(trained)
    propagation = max((row.n_propagation for row in rows), default=0)
    per_3d = failures["cost"]["flow3d_cpu_s"] / max(flow3d["runs"], 1)
    per_0d = failures["cost"]["zerod_cpu_s"] / max(zerod["runs"], 1)
    return {
        "n_3d": flow3d["runs"],
        "n_3d_ok": flow3d["runs"] - len(flow3d["failed"]),
        "n_0d": f"{zerod['runs'] + resampled:,}",
        "n_posterior": f"{posterior_runs:,}",
        "n_0d_parts": f"{zerod['runs'] - propagation:,} at the inputs of 3D runs, {propagation:,} for propagation"
        + (f", {resampled:,} for MFMC-AE{_of_each(trained, curve_nodes)}" if resampled else ""),
        "note": f"Average cost, without the start of its job: {per_3d:.1f} CPU-s for a 3D run and {per_0d:.4f} CPU-s "
        f"for a 0D run, a ratio of {per_3d / max(per_0d, 1e-12):.0f}.",
    }


def _of_each(trained: list[EstimatorReport], curve_nodes: int) -> str:
    """Return how the 0D runs of MFMC-AE come from those of its lines in the table."""
    own = {estimate.n_0d - estimate.n_3d for estimate in trained}
    if len(own) > 1:
        return ""
    (of_folds,) = own
    return (
        f": for each of its {len(trained)} quantities {of_folds} at the inputs that its folds pair, as in the table, "
        f"and {curve_nodes} of the fit to all runs, for its in-sample ρ"
    )


def _fit(fit, summary: Summary) -> dict:
    clinical = fit[fit["clinical"] & fit["tuned"]]
    off = (clinical["simulated"] / clinical["measured"] - 1).abs()
    worst = clinical.loc[off.idxmax(), "description"]
    worst = worst[:1].lower() + worst[1:]
    check, met = summary.predictive, summary.fit.largest_fraction_error
    return {
        "calibration": f"The tuned loop reproduces the {len(clinical)} measured targets to within "
        f"{100 * off.max():.1f} % (largest difference: {worst}).",
        "predictive": f"{100 * check.coverage_95:.0f} % of the target flows lie in the central 95 % of the posterior "
        f"predictive distribution; their mean squared Mahalanobis distance is {check.mean_squared_mahalanobis:.1f}, "
        f"where {len(check.flow_mean)} is expected (p = {check.p_value:.2f}); that of the mean flows is "
        f"{check.mahalanobis:.2f}. The fitted resistances reproduce the {len(check.flow_mean)} target "
        f"fractions to within {100 * met:.2g} %; the posterior mean, which the prior shifts, "
        f"to within {100 * check.largest_fraction_error:.2g} % (posterior/fractions.csv).",
    }


def _chains(summary: Summary, settings: Mapping) -> dict:
    """Return the verdict on the chains, with each limit beside its number, and how they were made."""
    rhat, ess = settings["rhat_limit"], settings["ess_limit"]
    verdict = "Converged" if summary.converged else "Not converged"
    return {
        "verdict": f"{verdict}: R-hat {summary.rhat_max:.3f}, limit {rhat:g}; smallest bulk effective sample size "
        f"{summary.ess_bulk_min:.0f}, limit {ess:.0f}",
        "class": "good" if summary.converged else "bad",
        "cost": f"{summary.chains} chains, {summary.model_runs:,} 0D runs, {summary.effective_per_run:.2f} effective "
        f"samples per run. {_steps(summary)}",
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


def _failed(failures: dict) -> list[dict]:
    stages = (("3D", failures["flow3d"]["failed"]), ("0D", failures["zerod"]["failed"]))
    return [{"sample": f["sample"], "stage": stage, "reason": f["reason"]} for stage, failed in stages for f in failed]


def _provenance(stamp: Mapping[str, object], files: Mapping[str, str]) -> list[tuple[str, str]]:
    lines = [(key, json.dumps(value) if isinstance(value, dict) else str(value)) for key, value in stamp.items()]
    return lines + [(f"SHA-256 of {Path(path).name}", provenance.checksum(path)) for path in files.values()]
