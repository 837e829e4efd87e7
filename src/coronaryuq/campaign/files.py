"""Descriptions of the files of a results folder; those of table columns are in `columns`."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from coronaryuq.campaign import columns
from coronaryuq.campaign.columns import Columns


@dataclass(frozen=True)
class Kind:
    """One kind of file. pattern: regular expression of the path in the results folder."""

    pattern: str
    what: str
    columns: Columns = ()


KINDS = (
    Kind(r"report\.html", "the report: a page that opens in any browser"),
    Kind(r"campaign\.yaml", "the whole configuration of the last run"),
    Kind(r"patient/case\.yaml", "the bundled patient: description of the case (docs/reference/case.md)"),
    Kind(r"patient/truth\.json", "the bundled patient: flows and quantities that the campaign should find, CGS"),
    Kind(r"patient/outlets\.csv", "the bundled patient: outlets", columns.OUTLETS),
    Kind(r"patient/targets\.csv", "the bundled patient: clinical targets; the file has no header", columns.TARGETS),
    Kind(r"(?:patient|case)/tree\.vtp", "centreline tree; lengths in cm"),
    Kind(
        r"(?:patient|case)/lv\.vtu",
        "cells of the left ventricle: Volume (cm3), MBF (patient/: mL/min/g; case/: mL/s/g)",
    ),
    Kind(r"case/case\.json", "the validated case, CGS (docs/explanation/architecture.md)"),
    Kind(r"case/network\.json", "0D network at rest before tuning, svZeroDSolver JSON, CGS"),
    Kind(r"perfusion/chunk_\d+\.npz", "outlet flows of a block of noisy realisations, mL/s"),
    Kind(r"perfusion/targets\.json", "target flows (mL/s), their covariance, territory volumes (cm3)"),
    Kind(r"(?:losses/)?calibration/(?:rest|hyperaemia)\.json", "the tuned loop, svZeroDSolver JSON, CGS"),
    Kind(r"(?:losses/)?calibration/parameters\.csv", "the tuned parameters", columns.PARAMETERS),
    Kind(r"(?:losses/)?calibration/fit\.csv", "clinical targets, measured against simulated", columns.FIT),
    Kind(r"losses/inputs\.csv", "inputs θ of the 3D runs that teach the 0D model its losses", columns.THETA),
    Kind(r"losses/runs\.jsonl", "one record per such run, columns as runs/outputs_3d.csv"),
    Kind(r"losses/checkpoints/.+", "state of the 3D solver, to resume from"),
    Kind(r"losses/losses\.csv", "pressure losses learnt, one per piece of the 3D domain and kind", columns.LOSSES),
    Kind(r"losses/fit\.json", "errors before and after, and the elements changed (docs/reference/formats.md)"),
    Kind(r"losses/network\.json", "0D network at rest with these losses, before tuning, svZeroDSolver JSON, CGS"),
    Kind(r"losses/hyperaemia_3d\.json", "the tuned loop for 3D runs, with the vessels' own losses, CGS"),
    Kind(r"adopted/before/(?:rest|hyperaemia)\.json", "the loop tuned without what was adopted, CGS"),
    Kind(r"adopted/before/parameters\.csv", "its tuned parameters", columns.PARAMETERS),
    Kind(r"adopted/before/fit\.csv", "clinical targets, measured against simulated by it", columns.FIT),
    Kind(r"adopted/before/length_\d+/chains(?:\.npz|/.+)", "chains of its posterior, and state to resume from"),
    Kind(r"adopted/before/length_\d+/draws\.csv", "thinned draws of its posterior", columns.DRAWS),
    Kind(
        r"adopted/network\.json", "0D network at rest with the adopted effects, before tuning, svZeroDSolver JSON, CGS"
    ),
    Kind(r"adopted/targets\.json", "target flows without the errors of the map that the search named"),
    Kind(r"adopted/hyperaemia_3d\.json", "the tuned loop for 3D runs, with what their lumen is narrowed by, CGS"),
    Kind(
        r"adopted/(?:adoption|in_3d|comparison)\.json",
        "what was adopted, what 3D has and cannot have of it, and FFR before and after (docs/explanation/adoption.md)",
    ),
    Kind(r"adopted/ffr_(?:before|after)\.csv", "FFR by 0D at samples of the posterior", columns.PREDICTED),
    Kind(r"posterior/length_\d+/chains\.npz", "every recorded state of every chain (docs/reference/formats.md)"),
    Kind(r"posterior/length_\d+/chains/.+", "state of the sampler, to resume from"),
    Kind(r"posterior/length_\d+/draws\.csv", "thinned draws from which samples are drawn", columns.DRAWS),
    Kind(
        r"posterior/posterior\.nc",
        "a DataTree for ArviZ: r (dimensionless), flows (mL/s) and log density of the kept states",
    ),
    Kind(r"posterior/summary\.json", "convergence, fit, marginals, predictive checks (docs/reference/formats.md)"),
    Kind(r"posterior/fitted\.json", "the hyperaemic loop with the fitted resistances, svZeroDSolver JSON, CGS"),
    Kind(r"posterior/draws\.csv", "thinned draws of the posterior", columns.DRAWS),
    Kind(r"posterior/fractions\.csv", "per outlet: target fraction, fitted and posterior fraction", columns.FRACTIONS),
    Kind(r"samples/(?:pilot|propagation)\.csv", "inputs θ of an input set", columns.THETA),
    Kind(r"(?:mesh|coarse|mesh_study/[^/]+)/mesh\.json", "description of the mesh, CGS (docs/reference/formats.md)"),
    Kind(r"(?:mesh|coarse|mesh_study/[^/]+)/mesh-complete(?:\.zip|/.+)", "the mesh in SimVascular's layout, cm"),
    Kind(
        r"(?:flow3d|coarse|mesh_study/[^/]+)/batch_\d+\.jsonl",
        "one record per 3D sample, columns as runs/outputs_3d.csv",
    ),
    Kind(r"(?:flow3d|coarse|mesh_study/[^/]+)/fields_\d+\.zip", "fields of the first 3D samples (VTU, VTP), CGS"),
    Kind(r"(?:flow3d|coarse|mesh_study/[^/]+)/checkpoints/.+", "state of the 3D solver, to resume from"),
    Kind(r"mesh_study/mesh_study\.json", "numerical error of every 3D quantity (docs/reference/formats.md)"),
    Kind(
        r"zerod/(?:pilot|propagation|resampled)_\d+\.parquet",
        "0D runs of an input set",
        (*columns.RUN, *columns.OUTPUTS),
    ),
    Kind(r"zerod/pressures\.csv", "mean pressure and flow along the tree, over the posterior", columns.PRESSURES),
    Kind(
        r"zerod/predicted\.csv",
        "lowest FFR of each artery and pressure drop over each lesion, over the posterior",
        columns.FOR_PHYSICIANS,
    ),
    Kind(r"runs/params(?:_coarse|_propagation)?\.csv", "inputs θ of runs (docs/reference/formats.md)", columns.THETA),
    Kind(r"runs/outputs_3d(?:_coarse)?\.csv", "3D quantities of the pilot", columns.OUTPUTS),
    Kind(r"runs/outputs_0d(?:_coarse|_propagation)?\.csv", "0D quantities", columns.OUTPUTS),
    Kind(r"runs/rows\.csv", "the quantities to estimate", columns.ROWS),
    Kind(r"runs/param_limits\.json", "bounds of θ (dimensionless)"),
    Kind(r"runs/failures\.json", "runs that failed, and the cost of a run (CPU s)"),
    Kind(r"allocation/round_\d+\.json", "plan and decision of a round of a growing campaign"),
    Kind(r"estimation/networks\.npz", "the trained shared space"),
    Kind(r"estimation/resampled\.csv", "the 0D inputs that the shared space requires", columns.THETA),
    Kind(r"(?:estimation|paper)/estimates\.json", "every estimator of every quantity (docs/reference/formats.md)"),
    Kind(
        r"(?:estimation|paper)/(?:budget|convergence|tuning)\.json",
        "variance against cost; convergence; tuning (docs/reference/formats.md)",
    ),
    Kind(r"estimation/table\.csv", "every estimator of every quantity, one line each", columns.TABLE),
    Kind(
        r"(?:estimation|paper)/pairs\.csv",
        "3D and 0D outputs, at the same and at the resampled inputs",
        columns.OUTPUT_PAIRS,
    ),
    Kind(r"paper_table\.csv", "the published runs' table next to the paper's columns", columns.PAPER_TABLE),
    Kind(r"paper_table\.md", "the published runs' table as Markdown"),
    Kind(r"coverage/n_\d+\.json", "coverage of the intervals at one pilot size"),
    Kind(r"coverage/table\.csv", "coverage of the intervals at all pilot sizes", columns.COVERAGE),
    Kind(
        r"discrepancy/[^/]+/case/(?:model\.json|conditions\.yaml|truth\.json)",
        "a case to search, CGS unless stated otherwise",
    ),
    Kind(r"discrepancy/[^/]+/(?:case|found)/measurements\.csv", "its measurements", columns.MEASUREMENTS),
    Kind(
        r"discrepancy/[^/]+/(?:case|found)/drives/[^/]+\.csv",
        "waveform that drives the model, in the model's units",
        columns.DRIVE,
    ),
    Kind(r"discrepancy/[^/]+/found/discrepancy\.json", "result of the search (docs/how-to/discrepancy.md)"),
    Kind(
        r"discrepancy/[^/]+/found/(?:paragraph|difference)\.txt",
        "the result in words; changes made in the repaired model",
    ),
    Kind(
        r"discrepancy/[^/]+/found/(?:repaired\.json|rewired\.json|conditions\.yaml)",
        "the repaired model, or the one without a wiring error, in the model's units",
    ),
    Kind(r"discrepancy/[^/]+/found/located\.csv", "where the recalibrated model misfits", columns.LOCATED),
    Kind(r"discrepancy/[^/]+/found/residuals\.csv", "measured, recalibrated and repaired values", columns.MEASUREMENTS),
    Kind(
        r"discrepancy/[^/]+/found/(?:ranking|sizes|effects)\.csv",
        "candidates by round; sizes of the named effects",
        columns.EFFECT,
    ),
    Kind(
        r"discrepancy/[^/]+/found/detectable\.csv",
        "signal that each candidate would leave in the fitted data at its typical size",
        columns.DETECTABLE,
    ),
    Kind(r"discrepancy/[^/]+/found/tree\.csv", "vessels with the misfit measured at their ends", columns.TREE),
    Kind(
        r"discrepancy/[^/]+/found/pullback\.csv",
        "readings of each pullback, and the model before and after",
        columns.PULLBACK,
    ),
    Kind(
        r"discrepancy/[^/]+/found/source\.csv",
        "waveform of an unknown source of flow, where the search names nothing",
        columns.SOURCE,
    ),
    Kind(r"discrepancy/[^/]+/(?:found|known)/gap\.csv", "held-out misfit of the models", columns.GAP),
    Kind(r"discrepancy/[^/]+/known/gap\.json", "held-out misfit with the true effect"),
    Kind(r"discrepancy/pairs/found/pairs\.csv", "pairs of measured and simulated values", columns.PAIRS),
    Kind(r"discrepancy/pairs/found/laws\.csv", "laws of the pressure drop that were compared", columns.LAWS),
    Kind(r"discrepancy/pairs/found/predicted\.csv", "FFR over the samples by each model", columns.PAIRS_PREDICTED),
    Kind(r"discrepancy/[^/]+/figures/[^/]+\.(?:png|svg)", "figure of a search"),
    Kind(r"discrepancy/(?:benchmark/)?report\.html", "report on the searches, or on their benchmark"),
    Kind(r"discrepancy/benchmark/[^/]+/seed_\d+\.json", "hidden cases of one seed, and the search's answers"),
    Kind(r"discrepancy/benchmark/(?:shares|cells|answers)\.csv", "how often the search is right", columns.BENCHMARK),
    Kind(r"discrepancy/benchmark/[^/]+\.png", "how often the search is right"),
    Kind(r"(?:figures|paper|coverage)/[^/]+\.(?:png|svg)", "figure"),
    Kind(r"costs/.+\.json", "cost of a job: wall and CPU time (s), memory (MB)"),
)
"""Every kind of file that a campaign may write."""

FOLDERS = {
    "patient": "the bundled patient, in the formats of a real case",
    "case": "the checked case",
    "perfusion": "target flows from the perfusion map",
    "calibration": "the tuned closed loop",
    "losses": "pressure losses that 3D runs teach the 0D model",
    "adopted": "what the campaign adopted from the search, and its prediction before and after",
    "posterior": "posterior of the outlet resistances",
    "samples": "inputs of the runs",
    "mesh": "the 3D mesh",
    "flow3d": "3D runs",
    "coarse": "the coarse 3D level",
    "mesh_study": "error of mesh and time step",
    "zerod": "0D runs",
    "runs": "all runs in the published-runs format",
    "allocation": "decisions of a growing campaign",
    "estimation": "estimates with their intervals",
    "paper": "the published runs",
    "coverage": "coverage of the intervals",
    "discrepancy": "search for a missing effect",
    "figures": "figures",
    "costs": "cost of every job",
    "logs": "output of every job",
    "provenance": "notes of the jobs, read by `coronaryuq explain` and `coronaryuq verify`",
}


def kind_of(path: str) -> Kind | None:
    """Return the kind of a file by its path in the results folder, or None for a file that no job writes."""
    return next((kind for kind in KINDS if re.fullmatch(kind.pattern, path)), None)


def described(kind: Kind, names: Iterable[str]) -> list[dict[str, str]]:
    """Return name, meaning and unit of columns; a column that matches no expression is left out."""
    found = []
    for name in names:
        for expression, what, unit in kind.columns:
            if re.fullmatch(expression, name):
                found.append({"name": name, "what": what, "unit": unit})
                break
    return found


def units(path: str, names: Iterable[str]) -> dict[str, str]:
    """Return the unit of every described column of a table, by its path in the results folder."""
    kind = kind_of(path)
    return {column["name"]: column["unit"] for column in described(kind, names)} if kind else {}
