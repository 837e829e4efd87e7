"""The tuned heart as an inference: a Gauss-Newton posterior of its parameters in a few latent coordinates.

The measured values have errors, so that many hearts fit them. Tuning finds the most probable one (`search.Objective`);
around it the measures are linearised, which makes the posterior normal. Of its directions only those count that change
what the coronary arteries see under hyperaemia: aortic pressure and the beds' flows. They become uncertain parameters
of the network, log-linear factors on many of its values.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from coronaryuq.calibration import parameters
from coronaryuq.calibration.hyperaemic_flow import hyperaemic_changes
from coronaryuq.calibration.loop import Loop
from coronaryuq.calibration.targets import PRESSURES, TUNED, counted, measurement_covariance
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.case.network import parameter_names
from coronaryuq.case.network.network import HEART, VISCOSITY, Network
from coronaryuq.zerod.network.beds import beds

STEP = 0.02
"""Of a parameter's range, for differences."""
SHARE = 0.95
"""Fraction of the variance of each pressure and flow that the coronary arteries see which the latent coordinates carry,
at least, so that no standard deviation of the linearised loop is more than 3 % too small."""
MOST = 6
"""Latent coordinates at most."""
FREE = np.array([k for k, p in enumerate(parameters.PARAMETERS) if p.logarithmic and p.name != "V_blood"])
"""Parameters that vary: those with a place in the network and a logarithm. Unstressed volumes and the blood volume,
which move the same measures, stay."""


@dataclass(frozen=True)
class Normal:
    """A normal distribution: mean (n,) and covariance (n, n)."""

    mean: np.ndarray
    covariance: np.ndarray


def gauss_newton(
    model: Callable[[np.ndarray], np.ndarray], prior: Normal, data: np.ndarray, noise: np.ndarray, step: np.ndarray,
    iterations: int = 1,
) -> Normal:  # fmt: skip
    """Return the posterior of parameters by linearising a model around the latest estimate, at first the prior's mean.

    Parameters
    ----------
    model
        Parameters (m, n) → predictions (m, d).
    prior, data, noise
        Prior of the parameters, measured values (d,) and their covariance (d, d).
    step
        Steps (n,) of central differences.
    iterations
        Linearisations.
    """
    point = prior.mean
    for _ in range(iterations):
        middle, slopes = linearised(model, point, step)
        weighted = np.linalg.solve(noise, slopes)
        covariance = np.linalg.inv(slopes.T @ weighted + np.linalg.inv(prior.covariance))
        pull = weighted.T @ (data - middle + slopes @ (point - prior.mean))
        point = prior.mean + covariance @ pull
    return Normal(point, 0.5 * (covariance + covariance.T))


def linearised(
    model: Callable[[np.ndarray], np.ndarray], point: np.ndarray, step: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return predictions (d,) at a point (n,) and their slopes (d, n) by central differences.

    A shifted point whose predictions are all NaN has none: the other side counts alone, and without either the
    parameter has no slope, so that it keeps its prior.
    """
    shifts = np.diag(step)
    values = model(np.vstack([point, point + shifts, point - shifts]))
    n = len(point)
    middle, sides = values[0], (values[1 : n + 1], values[n + 1 :])
    missing = [np.isnan(side).all(axis=1) for side in sides]
    above, below = (np.where(m[:, None], middle, side) for m, side in zip(missing, sides, strict=True))
    width = np.maximum(2.0 - missing[0] - missing[1], 1.0) * step
    return middle, ((above - below) / width[:, None]).T


class HeartModel:
    """The tuned loop as a function of its free parameters: what was measured of it, and what the arteries see.

    Every run starts from the tuned loop's periodic states, with the blood of these.

    Parameters
    ----------
    loop
        The loop that was tuned.
    point, states
        Tuned parameters (36,) and their periodic states, at rest and under hyperaemia.
    measured
        Names of the targets to predict.
    hyperaemia
        Factor on Ra and Ram of every bed.

    Attributes
    ----------
    measured, seen
        Names of the predictions: measures at rest; pressures and beds whose flow the arteries see.
    """

    def __init__(
        self, loop: Loop, point: np.ndarray, states: tuple[np.ndarray, np.ndarray], measured: Sequence[str],
        hyperaemia: float,
    ):  # fmt: skip
        self.loop, self.point, self.states, self.hyperaemia = loop, point, states, hyperaemia
        self.measured = list(measured)
        self._flows = dict(zip(beds(loop.network), loop.bed_flows(list(beds(loop.network))), strict=True))
        self.seen = [*PRESSURES, *self._flows]

    def __call__(self, free: np.ndarray, steps: int) -> np.ndarray:
        """Return measures at rest and the logarithms of what the arteries see, (m, d + q); NaN if not periodic."""
        points = np.tile(self.point, (len(free), 1))
        points[:, FREE] = free
        rest = self.loop.evaluate(points, self._start(points, 0), steps_per_cycle=steps, refill=False)
        extra = hyperaemic_changes(self.loop.network, points, self.hyperaemia)
        seen = self.seen_by_arteries(points, extra, steps)
        measured = np.array([rest.measures[name] for name in self.measured]).T
        ok = rest.ok & ~np.isnan(seen).all(axis=1)
        return np.where(ok[:, None], np.hstack([measured, seen]), np.nan)

    def seen_by_arteries(self, points: np.ndarray, extra: Mapping[str, np.ndarray | float], steps: int) -> np.ndarray:
        """Return the logarithms (m, q) of mmHg and mL per cycle under hyperaemia, which `extra` brings about."""
        stress = self.loop.evaluate(
            points, self._start(points, 1), steps_per_cycle=steps, extra=extra, waveforms=list(self._flows.values()),
            refill=False,
        )  # fmt: skip
        flows = [np.trapezoid(stress.waves[name], stress.time, axis=1) for name in self._flows.values()]
        seen = np.log([*(stress.measures[name] for name in PRESSURES), *flows]).T
        return np.where(stress.ok[:, None], seen, np.nan)

    def _start(self, points: np.ndarray, condition: int) -> np.ndarray:
        return np.tile(self.states[condition], (len(points), 1))


@dataclass(frozen=True)
class HeartPosterior:
    """Posterior of the free parameters, in searched coordinates, and the latent coordinates that carry it.

    directions (n, k): change of the free parameters per standard normal coordinate. captured: least fraction of the
    variance of any of what the coronary arteries see. relative_sd: measure → its posterior standard deviation over its
    error. steps: time steps per cycle of the runs that it comes from.
    """

    posterior: Normal
    directions: np.ndarray
    captured: float
    relative_sd: dict[str, float]
    steps: int


def prior_about(centre: np.ndarray) -> Normal:
    """Return the prior of the free parameters about a point (36,)."""
    return Normal(centre[FREE], np.diag(parameters.PRIOR_SD[FREE] ** 2))


def heart_posterior(
    loop: Loop, point: np.ndarray, states: tuple[np.ndarray, np.ndarray], targets: Mapping[str, float],
    hyperaemia: float, errors: RoutineErrors, most_steps: int,
) -> HeartPosterior:  # fmt: skip
    """Return the posterior of the heart around the tuned point.

    Where the tuned loop has no periodic state at the loop's time steps, they are halved until it has one.

    Parameters
    ----------
    loop
        The loop that was tuned.
    point, states
        Tuned parameters (36,) and their periodic states, at rest and under hyperaemia.
    targets, errors
        Measured values in their own units, and their errors.
    hyperaemia
        Factor on Ra and Ram of every bed.
    most_steps
        Time steps per cycle at which the tuned loop is known to be periodic.
    """
    model = HeartModel(loop, point, states, [n for n in TUNED if n in targets and not counted(n)], hyperaemia)
    prior, names = prior_about(point), model.measured
    centre, step = prior.mean, STEP * (parameters.UPPER - parameters.LOWER)[FREE]
    steps = loop.steps_per_cycle
    while np.isnan(model(centre[None], steps)).all():
        if steps >= most_steps:
            raise RuntimeError(f"the tuned loop has no periodic state at {steps} time steps per cycle")
        steps = min(2 * steps, most_steps)
    both = linearised(partial(model, steps=steps), centre, step)
    measured = np.isfinite(both[0][: len(names)]) & np.isfinite(both[1][: len(names)]).all(axis=1)
    slopes, seen = both[1][: len(names)][measured], both[1][len(names) :]
    known = [name for name, used in zip(names, measured, strict=True) if used]
    noise = measurement_covariance(targets, known, errors)
    # Tuning minimises the posterior's energy (`search.Objective`): the mean is the tuned point.
    posterior = gauss_newton(lambda free: (free - centre) @ slopes.T, prior, np.zeros(len(known)), noise, step)
    directions, captured = latent_directions(posterior.covariance, seen)
    spread = np.sqrt(np.einsum("ij,jk,ik->i", slopes, posterior.covariance, slopes) / np.diag(noise))
    return HeartPosterior(posterior, directions, captured, dict(zip(known, spread.tolist(), strict=True)), steps)


def latent_directions(covariance: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, float]:
    """Return directions (n, k) of parameters that carry at least `SHARE` of the variance of each linear output.

    The directions are those of the first k principal components of the outputs (q, n), each over its standard
    deviation: many uncertain flows must not hide one pressure. Parameters follow as their conditional mean given the
    components. At most `MOST`; the second result is the least share of any output.
    """
    variance = np.einsum("qn,nm,qm->q", seen, covariance, seen)
    scaled = seen[variance > 0.0] / np.sqrt(variance[variance > 0.0])[:, None]
    value, vector = np.linalg.eigh(scaled @ covariance @ scaled.T)
    order = np.argsort(value)[::-1]
    value, vector = value[order], vector[:, order]
    least = np.cumsum(vector**2 * value, axis=1).min(axis=0)
    count = min(int(np.searchsorted(least, SHARE)) + 1, MOST)
    vector = vector[:, :count] * np.where(vector[:, :count].sum(axis=0) < 0.0, -1.0, 1.0)
    return covariance @ scaled.T @ vector / np.sqrt(value[:count]), float(least[count - 1])


def heart_parameters(found: HeartPosterior, loop: Loop) -> list[dict[str, Any]]:
    """Return the latent coordinates as entries of `uncertain_parameters`, `heart_1` and so on."""
    entries = []
    for k in range(found.directions.shape[1]):
        targets = {}
        for column, place in enumerate(FREE):
            parameter, coefficient = parameters.PARAMETERS[place], float(found.directions[column, k])
            if parameter.heart is not None:
                targets[f"{HEART}.{parameter.heart}"] = coefficient
            for member, kinds in parameter.beds:
                for bc in loop.network.boundary_conditions:
                    if bc["bc_type"] in kinds:
                        targets[f"{bc['bc_name']}.{member}"] = coefficient
        name = f"{parameter_names.HEART}{k + 1}"
        entries.append(
            {"name": name, "distribution": "lognormal", "centre": 1.0, "spread": 1.0, "kind": "factor"}
            | {"targets": targets, "unit": "1"}
            | {"meaning": "latent coordinate of the tuned heart", "source": "errors of cuff and echocardiogram"}
        )
    return entries


def assumed_parameters(network: Network, errors: RoutineErrors) -> list[dict[str, Any]]:
    """Return what is assumed rather than measured as entries of `uncertain_parameters`: hyperaemia and viscosity."""
    relaxed = {f"{bed.name}.{key}": 1.0 for bed in beds(network).values() for key in (bed.arterial, *bed.myocardial)}
    viscous = {f"{name}.R_poiseuille": 1.0 for name in network.vessel_names.values()}
    assumed = (
        ("hyperaemia", errors.hyperaemia, relaxed, "coronary resistance at hyperaemia over rest", "Wilson et al. 1990"),
        (VISCOSITY, errors.viscosity, viscous, "blood viscosity over the case's", "Pries et al. 1992"),
    )
    return [
        {"name": name, "distribution": "lognormal", "centre": 1.0, "spread": float(np.sqrt(np.log1p(sd**2)))}
        | {"kind": "factor", "targets": targets, "meaning": meaning, "unit": "1", "source": source}
        for name, sd, targets, meaning, source in assumed
        if sd > 0.0
    ]
