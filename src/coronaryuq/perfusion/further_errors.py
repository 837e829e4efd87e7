"""Errors of perfusion beside its noise: calibration of the map, registration, and the rule of territories.

Each is independent of the others and of the noise, so that covariances add.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.case.case_json import CaseOutlet
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.core.seeds import generator
from coronaryuq.core.units import MM
from coronaryuq.perfusion.territories import Ventricle

SHIFTS = 200
"""Random shifts of the map from which the covariance of registration is computed."""

Distances = Callable[[np.ndarray], np.ndarray]
"""Points (n, 3) cm → distances (n, outlets) cm, by one rule."""


@dataclass(frozen=True)
class FurtherErrors:
    """Target flows over all rules, `mean` (N,) mL/s, and the covariance (N, N) of each source of error.

    weights: rule of territories → its weight.
    """

    mean: np.ndarray
    covariances: dict[str, np.ndarray]
    weights: dict[str, float]


def further_errors(
    ventricle: Ventricle, outlets: Sequence[CaseOutlet], rules: dict[str, Distances], mean: np.ndarray,
    errors: RoutineErrors, seed: int,
) -> FurtherErrors:  # fmt: skip
    """Return target flows and covariances for a map.

    Parameters
    ----------
    ventricle, outlets
        The LV wall, and the outlets that perfuse it.
    rules
        Published rules of territories, the campaign's own first; all weigh the same, since no study tells them apart.
    mean
        (N,) target flows by the campaign's own rule, mL/s.
    errors, seed
        Errors of the case and the campaign's seed.
    """
    count = len(outlets)
    own = next(iter(rules))
    measured = len(ventricle.points) > count  # otherwise a table gives each outlet's flow: nothing is divided
    flows = {name: divided(ventricle, rule(ventricle.points), count) for name, rule in rules.items()}
    if not measured:
        flows = {own: flows[own]}
    weight = 1.0 / len(flows)
    shape = np.array([flow / flows[own] for flow in flows.values()]) * mean
    middle = shape.mean(axis=0)
    scale = np.hypot(errors.mbf_calibration, errors.tissue_density)
    covariances = {
        "calibration": scale**2 * np.outer(middle, middle),
        "territories": weight * (shape - middle).T @ (shape - middle),
        "registration": np.zeros((count, count)),
    }
    if measured and errors.registration > 0.0:
        shifted = []
        for k in range(SHIFTS):
            move = errors.registration * MM * generator(seed, "perfusion", "registration", k).normal(size=3)
            shifted.append(divided(ventricle, rules[own](ventricle.points + move), count))
        covariances["registration"] = np.atleast_2d(np.cov(np.array(shifted), rowvar=False))
    return FurtherErrors(middle, covariances, dict.fromkeys(flows, weight))


def divided(ventricle: Ventricle, distances: np.ndarray, outlets: int) -> np.ndarray:
    """Return the flow (outlets,) mL/s of the points that are nearest to each outlet."""
    return np.bincount(np.argmin(distances, axis=1), weights=ventricle.flows, minlength=outlets)
