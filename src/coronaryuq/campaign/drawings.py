"""The figures of a campaign and of the published runs, with the result files from which they are drawn."""

from coronaryuq.campaign.paths import Paths
from coronaryuq.config import Campaign

HELD_BACK = 20
"""Number of 3D runs that the convergence study holds out to judge a subsample."""
CASE = {"case": "case/case.json", "tree": "case/tree.vtp"}
DRAWS = {"posterior": "posterior/posterior.nc", "case": "case/case.json"}
FLOWS = DRAWS | {"targets": "perfusion/targets.json", "summary": "posterior/summary.json"}
ALWAYS = {
    "territories": CASE | {"lv": "case/lv.vtu"},
    "cardiac_function": {"fit": "calibration/fit.csv"},
    "marginals": DRAWS | {"summary": "posterior/summary.json"},
    "chains": DRAWS,
    "tree_ffr": CASE | {"pressures": "zerod/pressures.csv"},
    "flows": FLOWS,
    "flow_correlation": FLOWS,
}
INTERVALS = {"intervals_extremes": {"estimates": "estimates.json"}, "intervals_ffr": {"estimates": "estimates.json"}}
ESTIMATES = INTERVALS | {
    "intervals_wss": {"estimates": "estimates.json"},
    "scatter": {"pairs": "pairs.csv"},
    "budget": {"budget": "budget.json"},
}
"""Figures of a campaign by files in its folder of estimates."""
PUBLISHED = INTERVALS | {"osi_scatter": {"pairs": "pairs.csv"}, "osi_budget": {"budget": "budget.json"}}
"""The same of the published runs, whose example is maximum OSI."""


def figures(campaign: Campaign, paths: Paths) -> dict[str, dict[str, str]]:
    """Return the campaign's figures: name → inputs by keyword of the function that draws it."""
    chosen = ALWAYS | _in_folder(ESTIMATES, "estimation")
    if campaign.discrepancy.adopt:
        chosen |= {name: FLOWS | {"targets": "adopted/targets.json"} for name in ("flows", "flow_correlation")}
    if min(campaign.estimation.convergence_sizes, default=0) <= campaign.samples.n_3d - HELD_BACK:
        chosen["convergence"] = {"convergence": "estimation/convergence.json"}
    if campaign.backend == "ensemble" and campaign.flow3d.fields:
        chosen["walls"] = CASE | {"fields": "flow3d/fields_0.zip"}
        chosen["lumen"] = chosen["walls"] | {"mesh": "mesh/mesh.json"}
    return _of(chosen, paths)


def paper_figures(paths: Paths) -> dict[str, dict[str, str]]:
    """Return the figures of the published runs; their convergence has a rule of its own."""
    return _of(_in_folder(PUBLISHED, "paper"), paths)


def _in_folder(figures: dict[str, dict[str, str]], folder: str) -> dict[str, dict[str, str]]:
    return {name: {key: f"{folder}/{file}" for key, file in files.items()} for name, files in figures.items()}


def _of(figures: dict[str, dict[str, str]], paths: Paths) -> dict[str, dict[str, str]]:
    return {name: {key: paths.results(file) for key, file in files.items()} for name, files in figures.items()}
