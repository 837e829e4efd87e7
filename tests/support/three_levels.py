"""A 3D model, its coarse level and a 0D model with a known mean, as runs of a campaign."""

from dataclasses import replace

import numpy as np
import pandas as pd

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.runs.table import CoarseRuns, Row, Runs
from support.runs import runs_of

ROW = Row("osi", "osi", "flow", "maximum OSI")
LIMITS = np.tile([0.5, 2.0], (3, 1))


def rough(t: np.ndarray, waves: int) -> np.ndarray:
    """±1 with mean zero over [0.5, 2], which no regression on t finds."""
    return np.sign(np.sin(2 * np.pi * waves * t))


def smooth(theta: np.ndarray) -> np.ndarray:
    return theta[:, 0] ** 2 * np.sqrt(theta[:, 1]) + 0.3 * theta[:, 2]


MEAN = (2**3 - 0.5**3) / 4.5 * (2**1.5 - 0.5**1.5) / 2.25 + 0.3 * 1.25
"""Of the 3D quantity, θ uniform on [0.5, 2]³."""


def fine(theta: np.ndarray) -> np.ndarray:
    return smooth(theta) + 0.6 * rough(theta[:, 1], 400)


def coarse(theta: np.ndarray) -> np.ndarray:
    """Biased, bent, with most of the fine level's roughness and some of its own."""
    return 0.8 * smooth(theta) + 0.1 * theta[:, 2] ** 2 + 0.5 * rough(theta[:, 1], 400) + 0.1 * rough(theta[:, 2], 500)


def flow(theta: np.ndarray) -> np.ndarray:
    return theta[:, 0] + 0.2 * theta[:, 1]


def campaign(n: int, beyond: int, more: int, *name, failed: float = 0.0) -> Runs:
    """n pilot runs, `beyond` further coarse ones, `more` propagation samples, drawn anew for every `name`.

    failed: share of the range of θ_0, from the top, where coarse runs fail.
    """
    random = generator(6, "three levels", n, *name)
    pilot, further, propagation = (random.uniform(0.5, 2, (count, 3)) for count in (n, beyond, more))
    both = np.vstack([pilot, further])
    ran = np.where(both[:, 0] > 2 - 1.5 * failed, np.nan, coarse(both))
    level = CoarseRuns(pd.DataFrame({"osi": ran}), further, pd.DataFrame({"flow": flow(further)}))
    return runs_of(
        pilot, {"osi": fine(pilot)}, {"flow": flow(pilot)}, propagation, q_more={"flow": flow(propagation)},
        limits=LIMITS, coarse=level,
    )  # fmt: skip


def without_coarse(runs: Runs) -> Runs:
    return replace(runs, coarse=None)
