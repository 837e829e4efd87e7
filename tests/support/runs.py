"""Runs of a campaign, made from arrays."""

from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.estimation.runs.table import CoarseRuns, Runs


def runs_of(
    theta: np.ndarray, y: dict, q: dict, theta_more: np.ndarray, *, q_more: dict | None = None,
    theta_failed: np.ndarray | None = None, inputs: tuple[str, ...] = (), limits: np.ndarray | None = None,
    coarse: CoarseRuns | None = None,
) -> Runs:  # fmt: skip
    """Runs at pilot inputs (n, d) with outputs by name, and at propagation inputs (m, d); inputs are a, b, c, ..."""
    d = theta.shape[1]
    return Runs(
        folder=Path("."),
        inputs=inputs or tuple("abcdefghijklmnopqrstuvwxyz"[:d]),
        samples=tuple(map(str, range(len(theta)))),
        theta=theta,
        y=pd.DataFrame(y),
        q=pd.DataFrame(q),
        theta_more=theta_more,
        q_more=None if q_more is None else pd.DataFrame(q_more),
        theta_failed=np.empty((0, d)) if theta_failed is None else theta_failed,
        limits=limits,
        coarse=coarse,
    )
