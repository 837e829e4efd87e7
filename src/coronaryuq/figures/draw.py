"""All figures of a campaign, by name."""

import importlib
from collections.abc import Mapping

from coronaryuq.core.errors import InputError
from coronaryuq.figures.style import Output

FIGURES: dict[str, str] = {
    "cardiac_function": "coronaryuq.figures.calibration:cardiac_function",
    "territories": "coronaryuq.figures.scenes:territories",
    "marginals": "coronaryuq.figures.posterior:marginals",
    "flows": "coronaryuq.figures.posterior:flows",
    "flow_correlation": "coronaryuq.figures.posterior:flow_correlation",
    "chains": "coronaryuq.figures.posterior:chains",
    "tree_ffr": "coronaryuq.figures.scenes:tree_by_ffr",
    "walls": "coronaryuq.figures.scenes:walls",
    "lumen": "coronaryuq.figures.lumen:lumen",
    "osi_scatter": "coronaryuq.figures.estimates:osi_scatter",
    "scatter": "coronaryuq.figures.estimates:scatter",
    "intervals_wss": "coronaryuq.figures.estimates:intervals_wss",
    "intervals_extremes": "coronaryuq.figures.estimates:intervals_extremes",
    "intervals_ffr": "coronaryuq.figures.estimates:intervals_ffr",
    "convergence": "coronaryuq.figures.budget:convergence",
    "budget": "coronaryuq.figures.budget:budget",
    "osi_budget": "coronaryuq.figures.budget:osi_budget",
    "coverage": "coronaryuq.figures.coverage:coverage",
    "discrepancy_tree": "coronaryuq.figures.discrepancy:tree",
    "discrepancy_residuals": "coronaryuq.figures.discrepancy:residuals",
    "discrepancy_ranking": "coronaryuq.figures.discrepancy:ranking",
    "discrepancy_sizes": "coronaryuq.figures.discrepancy:sizes",
    "discrepancy_gap": "coronaryuq.figures.discrepancy:gap",
    "discrepancy_pullback": "coronaryuq.figures.pullback:pullback",
    "discrepancy_source": "coronaryuq.figures.flow_source:flow_source",
    "discrepancy_pairs": "coronaryuq.figures.discrepancy:pairs",
    "discrepancy_pairs_gap": "coronaryuq.figures.discrepancy:pairs_gap",
    "discrepancy_pairs_effects": "coronaryuq.figures.discrepancy:pairs_effects",
    "hidden_effects": "coronaryuq.figures.discrepancy_benchmark:hidden_effects",
    "rivals": "coronaryuq.figures.discrepancy_rivals:rivals",
}


def draw(name: str, inputs: Mapping[str, str], output: Output) -> None:
    """Draw a figure.

    Parameters
    ----------
    name
        Key of `FIGURES`.
    inputs
        Path of each input file, by the parameter's name of the function that draws.
    output
        PNG or SVG files.
    """
    if name not in FIGURES:
        raise InputError("figures", "figure", name, f"unknown figure; available: {', '.join(FIGURES)}")
    module, _, function = FIGURES[name].partition(":")
    getattr(importlib.import_module(module), function)(**inputs, output=output)


def module_of(name: str) -> str:
    """Return the module that draws the figure `name`."""
    return FIGURES[name].partition(":")[0]
