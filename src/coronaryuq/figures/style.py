"""The common style of all figures, and reproducible saving: the same numbers give the same bytes."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap, to_hex, to_rgba

from coronaryuq.core.io.atomic import replacing

# Okabe & Ito (2008): distinguishable with any colour vision, and in print. No estimator has an artery's colour.
BRANCHES = {"LAD": "#D55E00", "LCx": "#0072B2", "RCA": "#009E73"}
ESTIMATORS = {
    "MC": "#1A1A1A",
    "MFMC": "#8C7AB8",
    "MFMC-AE": "#B5477F",
    "BLUE": "#8A8D91",
    "crossfit-GP": "#4B2E83",
    "multilevel": "#8A6D1D",
}
MEASURED, SIMULATED = "#555555", "#4B2E83"
MUTED = "#999999"
FFR_LIMIT = 0.80
"""Below it a lesion counts as flow-limiting; every figure of FFR shows it."""
FFR_RANGE = (0.60, 1.0)
"""Of the colours of FFR."""
FFR_COLOURS = "viridis"
DARK = "#111111"
"""Of the edge at `FFR_LIMIT`."""

RULES: Any = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "figure.dpi": 100,
    "savefig.dpi": 150,
    "svg.hashsalt": "coronaryuq",
    "path.simplify": False,
}


def colour(branch: str) -> str:
    """Return the colour of a coronary branch, or of one of its stenoses (LAD2); grey for any other name."""
    return BRANCHES.get(branch.rstrip("0123456789"), MUTED)


def ffr_colours(number: int) -> list[str]:
    """Return `number` colours over `FFR_RANGE`, rising."""
    return [to_hex(ink) for ink in matplotlib.colormaps[FFR_COLOURS](np.linspace(0.0, 1.0, number))]


def ffr_map(edge: float = 0.004) -> ListedColormap:
    """Return the colour map of FFR over `FFR_RANGE`, with a dark edge within `edge` of the limit."""
    values = np.linspace(*FFR_RANGE, 1024)
    inks = matplotlib.colormaps[FFR_COLOURS](np.linspace(0.0, 1.0, 1024))
    inks[np.abs(values - FFR_LIMIT) < edge] = to_rgba(DARK)
    return ListedColormap(inks, name="ffr")


def limit_line(axis, along: str = "x") -> None:
    """Draw the limit of FFR, the same in every figure; along: the axis that shows FFR."""
    line = axis.axvline if along == "x" else axis.axhline
    line(FFR_LIMIT, color=DARK, lw=1.0, ls=(0, (4, 3)), zorder=0.5)


Output = str | Path | Sequence[str | Path]
"""A file, or the same figure in several formats."""


@contextmanager
def saved(output: Output, **subplots) -> Iterator[tuple]:
    """Yield a figure and its axes, and save the figure at the end.

    The files contain nothing that changes between runs, such as dates or software versions.

    Parameters
    ----------
    output
        PNG or SVG files.
    **subplots
        Options of `plt.subplots`.
    """
    paths = [Path(output)] if isinstance(output, str | Path) else [Path(path) for path in output]
    with plt.rc_context(RULES):
        subplots.setdefault("layout", "constrained")
        figure, axes = plt.subplots(**subplots)
        try:
            yield figure, axes
            for path in paths:
                metadata = {"Date": None, "Creator": None} if path.suffix == ".svg" else {"Software": None}
                with replacing(path) as temporary:
                    figure.savefig(temporary, metadata=metadata)
        finally:
            plt.close(figure)
