"""Pressure-loss laws in a branch of a table model: predictions, fits, and sizes with intervals."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from typing import Any

import numpy as np
from scipy.optimize import minimize

from coronaryuq.discrepancy.table_model.tables import Branch

Terms = dict[str, Any]
"""Term of the circuit → number, or (m, 1) for m sets of terms."""
SD_RECALIBRATION = 0.25
"""Prior standard deviation of the logarithms of bed resistance and of the model's own loss: recalibration."""
SD_OFFSET, SD_GAIN = 0.05, 0.05
"""Prior standard deviations of a sensor's offset over the root pressure, and of its gain."""
FLOOR_FFR, FLOOR_FLOW, FLOOR_OUTLET = 0.003, 0.02, 0.01
"""Accuracy of lumped losses in FFR, relative flow, and outlet over root pressure."""
SD_LOSS, MEDIAN_LOSS, MEDIAN_BEYOND = 1.2, 0.1, 0.01
"""Log-normal prior of a loss over the root pressure at the simulated flow, as in the library of effects."""


@dataclass(frozen=True)
class Law:
    """Effects and the terms that they add to the circuit of one branch."""

    effects: tuple[str, ...]
    terms: tuple[str, ...]


LAWS = (
    Law((), ()),
    Law(("quadratic_stenosis",), ("quadratic",)),
    Law(("quadratic_stenosis",), ("linear", "quadratic")),
    Law(("diffuse_narrowing",), ("linear",)),
    Law(("pressure_offset",), ("offset",)),
    Law(("pressure_gain",), ("gain",)),
    Law(("flow_gain",), ("flow",)),
    Law(("diffuse_narrowing", "pressure_offset"), ("linear", "offset")),
    Law(("quadratic_stenosis", "pressure_offset"), ("quadratic", "offset")),
    Law(("diffuse_narrowing", "pressure_gain"), ("linear", "gain")),
    Law(("quadratic_stenosis", "pressure_gain"), ("quadratic", "gain")),
)
"""A stenosis may add a viscous loss, linear in flow, to the quadratic one (Young & Tsai 1973)."""
ONE_EFFECT = tuple(law for law in LAWS if len(law.effects) < 2)
LOSSES = ("linear", "quadratic")
SENSORS = {"pressure_offset": "offset", "pressure_gain": "gain", "flow_gain": "flow"}
"""Sensor errors and their term."""
RECALIBRATION = ("bed", "own")
BEYOND = "beyond"
"""Loss distal to the place of the distal pressure: it lowers flow but is not part of the drop to that place."""
OWN_LOSS = (0.0, 4.0, 8.0)
"""Starting factors of the model's own loss, in prior standard deviations of their logarithm: recalibration of a model
that lacks a stenosis ends far from its prior, or in a worse optimum."""
NORMAL_90 = 1.6449
CURVATURE_STEP = 3e-4
SLOPE_STEP = float(np.sqrt(np.finfo(float).eps))
STEEPEST = 1e-3
"""Largest slope of a fit's objective at its optimum, nats per prior standard deviation: evidence is then exact to 1e-6
nats, which is as well as one-sided differences resolve the slope."""
ROOT = "root"
MOST_EFFECTIVE = 100
"""Maximum effective sample size: the error of a law is common to all samples and does not average out."""


@dataclass(frozen=True)
class LawFit:
    """Fit of one law: most probable terms, BIC approximation to the log evidence.

    point: (k,) the optimum in standard deviations of the priors.
    """

    law: Law
    terms: dict[str, float]
    evidence: float
    rms_ffr: float
    point: tuple[float, ...]

    @property
    def own(self) -> float:
        """Shift of the model's own loss by recalibration, in standard deviations of its prior."""
        return self.point[RECALIBRATION.index("own")]


@dataclass(frozen=True)
class Size:
    """A value and its 90 % interval."""

    value: float
    low: float
    high: float


def predict(branch: Branch, terms: Terms) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Predict FFR, flow, and outlet over root pressure, (n,) each, of every sample from the simulated outputs.

    terms: numbers, or (m, 1) each for m sets of terms, which gives (m, n).

    Solves P_root = z + (own D_0/Q_0 + R + R_end + bed R_bed) Q + S Q^2 per sample, with D_0 the simulated drop to the
    distal place, R_end the resistance from there to the outlet (the simulated one plus `BEYOND`), R_bed = (P_outlet -
    z) / Q_0 the resistance of the bed and z the zero-flow pressure. The root pressure is the simulated one times
    `ROOT`, by default the mean ratio of all samples. A sensor's offset and gain act on the readings of distal
    pressure and flow, and on the outlet pressure if that is the same reading.
    """
    bed = terms.get("bed", 1.0) * (branch.outlet0 - branch.venous) / branch.flow0
    end = (branch.distal0 - branch.outlet0) / branch.flow0 + terms.get(BEYOND, 0.0)
    series = terms.get("own", 1.0) * branch.drop0 / branch.flow0 + terms.get("linear", 0.0) + end + bed
    root = branch.root0 * terms.get(ROOT, float(np.mean(branch.root3) / np.mean(branch.root0)))
    quadratic, head = terms.get("quadratic", 0.0), root - branch.venous
    # This form avoids cancellation for a small quadratic loss.
    flow = 2.0 * head / (series + np.sqrt(series**2 + 4.0 * quadratic * head))
    outlet = branch.venous + bed * flow
    distal = outlet + end * flow
    gain, offset = 1.0 + terms.get("gain", 0.0), terms.get("offset", 0.0)
    if branch.one_sensor:
        outlet = gain * outlet + offset
    return (gain * distal + offset) / root, flow * (1.0 + terms.get("flow", 0.0)), outlet / root


def fit_law(branch: Branch, law: Law, rows: np.ndarray, near: Sequence[float] = ()) -> LawFit:
    """Fit a law to the samples `rows` (n,) bool, with the noise of each output profiled out above its floor.

    Minimises n/2 (log s^2 + mean square / s^2) of FFR, flow and outlet pressure plus the priors, with n at most
    `MOST_EFFECTIVE`. The log evidence is lowered by k/2 log n for the k terms of the law, and by log 10
    for each effect. near: an optimum of other samples, from which it starts beside the prior's mean.
    """
    terms, objectives = _posterior(branch, law, rows)

    def with_gradient(z: np.ndarray) -> tuple[float, np.ndarray]:
        steps = SLOPE_STEP * np.maximum(1.0, np.abs(z))
        values = objectives(np.vstack([z, z + np.diag(steps)]))
        return values[0], (values[1:] - values[0]) / steps

    none = np.zeros(len(law.terms))
    starts = [np.r_[0.0, own, 0.0, none] for own in OWN_LOSS]
    starts += [np.r_[0.0, 0.0, 0.0, none + k] for k in (-1.0, 1.0) if law.terms]
    starts = [np.zeros(len(near)), np.array(near)] if near else starts
    optima = [minimize(with_gradient, start, method="BFGS", jac=True, options={"gtol": STEEPEST}) for start in starts]
    best = min(optima, key=lambda optimum: optimum.fun)
    fitted: Terms = {name: float(value) for name, value in terms(best.x).items()}
    rms = float(np.sqrt(np.mean((predict(branch, fitted)[0] - branch.distal3 / branch.root3)[rows] ** 2)))
    weight = min(int(rows.sum()), MOST_EFFECTIVE)
    evidence = -float(best.fun) - 0.5 * len(law.terms) * np.log(weight) - len(law.effects) * np.log(10.0)
    return LawFit(law, fitted, evidence, rms, tuple(best.x))


def _posterior(
    branch: Branch, law: Law, rows: np.ndarray
) -> tuple[Callable[[np.ndarray], Terms], Callable[[np.ndarray], np.ndarray]]:
    """Return functions for the terms at a point z (k,) of standard normal priors, and the objectives (m,) at (m, k)."""
    ffr = branch.distal3 / branch.root3
    names = [*RECALIBRATION, BEYOND, *law.terms]
    root = float(branch.root3[rows].mean() / branch.root0[rows].mean())
    weight = min(int(rows.sum()), MOST_EFFECTIVE)
    scale = {
        "linear": branch.root0.mean() / branch.flow0.mean() * MEDIAN_LOSS,
        "quadratic": branch.root0.mean() / branch.flow0.mean() ** 2 * MEDIAN_LOSS,
        BEYOND: branch.root0.mean() / branch.flow0.mean() * MEDIAN_BEYOND,
        "offset": SD_OFFSET * branch.root0.mean(),
        "gain": SD_GAIN,
        "flow": SD_GAIN,
    }

    def terms(z: np.ndarray) -> Terms:
        found: Terms = {ROOT: root}
        for name, value in zip(names, z, strict=True):
            if name in RECALIBRATION:
                found[name] = np.exp(SD_RECALIBRATION * value)
            elif name == BEYOND or name in LOSSES:
                found[name] = scale[name] * np.exp(SD_LOSS * value)
            else:
                found[name] = scale[name] * value
        return found

    def objectives(points: np.ndarray) -> np.ndarray:
        predicted, flow, outlet = predict(branch, terms(points.T[:, :, None]))
        misfit = np.zeros(len(points))
        errors = (predicted - ffr, flow / branch.flow3 - 1.0, outlet - branch.outlet3 / branch.root3)
        for error, floor in zip(errors, (FLOOR_FFR, FLOOR_FLOW, FLOOR_OUTLET), strict=True):
            variance = np.mean(error[:, rows] ** 2, axis=1)
            sd2 = np.maximum(variance, floor**2)
            misfit += 0.5 * weight * (np.log(sd2) + variance / sd2)
        return misfit + 0.5 * np.sum(points**2, axis=1)

    return terms, objectives


def sizes(branch: Branch, fit: LawFit, rows: np.ndarray) -> dict[str, Size]:
    """Return each term of a fitted law, and the dimensionless size of each of its effects, with 90 % intervals.

    Laplace approximation at the optimum, no wider than the prior, on a log scale for losses; the uncertainty of the
    zero-flow pressure, which a fit takes as known, is propagated. The size of an effect is the fraction of the mean
    simulated root pressure that a loss takes at the mean simulated flow or that an offset adds, or a gain itself.
    """
    terms, objectives = _posterior(branch, fit.law, rows)
    z = np.array(fit.point)
    steps = CURVATURE_STEP * np.eye(len(z))
    around = [z + s * a + t * b for a in steps for b in steps for s in (1, -1) for t in (1, -1)]
    mixed = objectives(np.array(around)).reshape(len(z), len(z), 4) @ [1.0, -1.0, -1.0, 1.0]
    values, vectors = np.linalg.eigh(mixed / (2.0 * CURVATURE_STEP) ** 2)
    covariance = vectors @ np.diag(1.0 / np.maximum(values, 1.0)) @ vectors.T

    def gradient(venous: float) -> np.ndarray:
        _, shifted = _posterior(replace(branch, venous=venous), fit.law, rows)
        return (shifted(z + steps) - shifted(z - steps)) / (2.0 * CURVATURE_STEP)

    gradients = [gradient(branch.venous + s * branch.venous_sd) for s in (0.5, -0.5)]
    shift = covariance @ (gradients[0] - gradients[1])
    covariance = covariance + np.outer(shift, shift)

    def interval(size: Callable[[Terms], Any], positive: bool) -> Size:
        def on_scale(point: np.ndarray) -> float:
            value = size(terms(point))
            return np.log(value) if positive else value

        slope = np.array([on_scale(z + step) - on_scale(z - step) for step in steps]) / (2.0 * CURVATURE_STEP)
        half = NORMAL_90 * np.sqrt(slope @ covariance @ slope)
        ends = (on_scale(z), on_scale(z) - half, on_scale(z) + half)
        return Size(*(float(np.exp(end) if positive else end) for end in ends))

    intervals = {name: interval(itemgetter(name), name in LOSSES) for name in fit.law.terms}
    flow, root = float(branch.flow0.mean()), float(branch.root0.mean())

    def dimensionless(effect: str, found: Terms) -> Any:
        if effect in SENSORS:
            return found[SENSORS[effect]] / (root if SENSORS[effect] == "offset" else 1.0)
        return (found.get("linear", 0.0) * flow + found.get("quadratic", 0.0) * flow**2) / root

    return intervals | {name: interval(partial(dimensionless, name), name not in SENSORS) for name in fit.law.effects}


def fit_laws(
    branch: Branch, rows: np.ndarray, laws: tuple[Law, ...] = LAWS, near: Iterable[LawFit] = ()
) -> list[LawFit]:
    """Fit laws to the samples `rows` (n,) bool, best first. near: their fits to other samples."""
    points = {fit.law: fit.point for fit in near}
    return sorted((fit_law(branch, law, rows, points.get(law, ())) for law in laws), key=lambda fit: -fit.evidence)
