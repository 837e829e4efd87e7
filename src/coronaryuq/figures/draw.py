"""Every figure of a campaign by its name."""

from collections.abc import Callable, Mapping

from coronaryuq.core.errors import InputError

FIGURES: dict[str, str] = {
    "cardiac_function": "coronaryuq.figures.calibration:cardiac_function",
    "territories": "coronaryuq.figures.scenes:territories",
    "marginals": "coronaryuq.figures.posterior:marginals",
    "flows": "coronaryuq.figures.posterior:flows",
    "flow_covariance": "coronaryuq.figures.posterior:flow_covariance",
    "tree_ffr": "coronaryuq.figures.scenes:tree_by_ffr",
    "walls": "coronaryuq.figures.scenes:walls",
    "lumen": "coronaryuq.figures.scenes:lumen",
    "osi_scatter": "coronaryuq.figures.estimates:osi_scatter",
    "intervals_wss": "coronaryuq.figures.estimates:intervals_wss",
    "intervals_ffr": "coronaryuq.figures.estimates:intervals_ffr",
    "convergence": "coronaryuq.figures.budget:convergence",
    "budget": "coronaryuq.figures.budget:budget",
    "coverage": "coronaryuq.figures.coverage:coverage",
    "discrepancy_tree": "coronaryuq.figures.discrepancy:tree",
    "discrepancy_residuals": "coronaryuq.figures.discrepancy:residuals",
    "discrepancy_ranking": "coronaryuq.figures.discrepancy:ranking",
    "discrepancy_sizes": "coronaryuq.figures.discrepancy:sizes",
    "discrepancy_gap": "coronaryuq.figures.discrepancy:gap",
    "discrepancy_pairs": "coronaryuq.figures.discrepancy:pairs",
    "discrepancy_pairs_gap": "coronaryuq.figures.discrepancy:pairs_gap",
    "discrepancy_pairs_effects": "coronaryuq.figures.discrepancy:pairs_effects",
    "discovery": "coronaryuq.figures.discrepancy_benchmark:discovery",
}


def draw(name: str, inputs: Mapping[str, str], output: str) -> None:
    """Draw the figure `name` from its input files to `output` (PNG or SVG)."""
    if name not in FIGURES:
        raise InputError(output, "figure", name, f"unknown figure; there are {', '.join(FIGURES)}")
    _function(FIGURES[name])(**inputs, output=output)


def _function(where: str) -> Callable:
    import importlib

    module, _, function = where.partition(":")
    return getattr(importlib.import_module(module), function)
