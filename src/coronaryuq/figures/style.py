"""The common style of all figures, and reproducible saving: the same numbers give the same bytes."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt

from coronaryuq.core.io.atomic import replacing

# Okabe & Ito (2008): distinguishable with any colour vision, and in print.
ESTIMATORS = {
    "MC": "#000000",
    "MFMC": "#0072B2",
    "MFMC-AE": "#D55E00",
    "BLUE": "#CC79A7",
    "crossfit-GP": "#009E73",
    "multilevel": "#E69F00",
}
BRANCHES = {"LAD": "#D55E00", "LCx": "#0072B2", "RCA": "#009E73"}
MEASURED, SIMULATED = "#555555", "#0072B2"
MUTED = "#999999"

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


@contextmanager
def saved(path: str | Path, **subplots) -> Iterator[tuple]:
    """Yield a figure and its axes, and save the figure at the end.

    The file contains nothing that changes between runs, such as dates or software versions.

    Parameters
    ----------
    path
        PNG or SVG file.
    **subplots
        Options of `plt.subplots`.
    """
    path = Path(path)
    with plt.rc_context(RULES):
        subplots.setdefault("layout", "constrained")
        figure, axes = plt.subplots(**subplots)
        try:
            yield figure, axes
            metadata = {"Date": None, "Creator": None} if path.suffix == ".svg" else {"Software": None}
            with replacing(path) as temporary:
                figure.savefig(temporary, metadata=metadata)
        finally:
            plt.close(figure)
