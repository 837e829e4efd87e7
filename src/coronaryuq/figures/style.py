"""One look for all figures, and one way to save them: the same numbers give the same bytes."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt

from coronaryuq.core.io.atomic import replacing

# Okabe & Ito (2008): told apart with any colour vision, and in print.
ESTIMATORS = {
    "MC": "#000000",
    "MFMC": "#0072B2",
    "MFMC-AE": "#D55E00",
    "BLUE": "#CC79A7",
    "best": "#009E73",
    "multilevel": "#E69F00",
}
BRANCHES = {"LAD": "#D55E00", "LCx": "#0072B2", "RCA": "#009E73"}
MEASURED, SIMULATED = "#555555", "#0072B2"
MUTED = "#999999"

RULES = {
    "font.family": "DejaVu Sans",  # comes with matplotlib, so the same on every machine
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
    """Colour of a coronary branch; grey for one that is not among the three main ones."""
    return BRANCHES.get(branch, MUTED)


@contextmanager
def saved(path: str | Path, **subplots) -> Iterator[tuple]:
    """Give a figure and its axes (as `plt.subplots` would); write them to `path` (PNG or SVG) at the end.

    Nothing that changes from run to run goes into the file: no date, no version of the software.
    """
    path = Path(path)
    with plt.rc_context(RULES):
        subplots.setdefault("layout", "constrained")
        figure, axes = plt.subplots(**subplots)
        try:
            yield figure, axes
            metadata = {"Date": None, "Creator": None} if path.suffix == ".svg" else {"Software": None}
            with replacing(path) as beside:
                figure.savefig(beside, metadata=metadata)
        finally:
            plt.close(figure)
