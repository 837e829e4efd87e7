"""Gaussian-process emulators of 0D outputs: the 0D model at inputs where it was not run.

A 0D mean flow or FFR is a smooth function of θ. A control variate uses 0D outputs through an emulator fitted without
the fold that it is used on, so it is a function of θ alone and the estimator stays unbiased whatever the emulator's
error is; the error only reduces correlation.
"""

import numpy as np
import pandas as pd

from coronaryuq.estimation.surrogates import gaussian_process

FAMILIES = ("mean_flow", "ffr")
"""Prefixes of the campaigns' 0D outputs from which informative ones are chosen: mean flows and FFR."""


def informative(q: pd.DataFrame, first: list[str], most: int = 8, families: tuple[str, ...] = FAMILIES) -> list[str]:
    """Return the names of up to `most` informative 0D outputs after those in `first`.

    Greedy: the output with the largest share of variance that those already chosen leave unexplained, until that share
    is below 1e-5. It uses 0D runs only, so no information on 3D outputs leaks into the choice.

    Parameters
    ----------
    q
        0D outputs (n rows).
    first
        Names of outputs that are always included.
    most
        Maximum number of names.
    families
        Prefixes of the outputs to choose from.
    """
    taken = list(dict.fromkeys(first))
    left_out = [c for c in q.columns if str(c).startswith(families) and c not in taken]
    values = q[left_out].to_numpy(dtype=float)
    moving = values.std(axis=0) > 1e-9 * (np.abs(values).max(axis=0) + 1e-300)
    left_out, values = [c for c, keep in zip(left_out, moving, strict=True) if keep], values[:, moving]
    while left_out and len(taken) < most:
        standard = (values - values.mean(axis=0)) / values.std(axis=0)
        basis = np.column_stack([np.ones(len(q)), q[taken].to_numpy(dtype=float)]) if taken else np.ones((len(q), 1))
        left = (standard - basis @ np.linalg.lstsq(basis, standard, rcond=None)[0]).var(axis=0)
        best = int(left.argmax())
        if left[best] < 1e-5:
            break
        taken.append(left_out.pop(best))
        values = np.delete(values, best, axis=1)
    return taken


class Emulator:
    """Emulators of several 0D outputs on one training set: inputs (n, d) of log θ, outputs by name (n,)."""

    def __init__(self, log_theta: np.ndarray, outputs: pd.DataFrame):
        self.names = tuple(outputs.columns)
        self.models = [
            gaussian_process.fit(log_theta, outputs[name].to_numpy(dtype=float), evaluations=24) for name in self.names
        ]

    def predict(self, log_theta: np.ndarray) -> dict[str, np.ndarray]:
        """Every output by name (m,) at log θ (m, d)."""
        return {name: model.predict(log_theta) for name, model in zip(self.names, self.models, strict=True)}
