"""Laws of pressure loss in a branch of a table model: what each predicts, its fit, and its sizes with intervals."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from coronaryuq.discrepancy.table_model.tables import Branch

SD_RECALIBRATION = 0.25
"""Prior standard deviation of the logarithms of bed resistance and of the model's own loss: recalibration."""
SD_OFFSET, SD_GAIN = 0.05, 0.05
"""Prior standard deviations of a sensor's offset over the root's pressure, and of its gain."""
FLOOR_FFR, FLOOR_FLOW, FLOOR_OUTLET = 0.003, 0.02, 0.01
"""Errors (FFR, relative flow, outlet over root pressure) below which lumped losses are not to be believed."""
SD_LOSS, MEDIAN_LOSS, MEDIAN_BEYOND = 1.2, 0.1, 0.01
"""Log-normal prior of a loss over the root's pressure at the simulated flow, as in the library of effects."""


@dataclass(frozen=True)
class Law:
    """Named effects and the terms that they bring into one branch's circuit."""

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
"""A stenosis may bring its throat's viscous loss, linear in flow, beside the quadratic one (Young & Tsai 1973)."""
ONE_EFFECT = tuple(law for law in LAWS if len(law.effects) < 2)
LOSSES = ("linear", "quadratic")
SENSORS = {"pressure_offset": "offset", "pressure_gain": "gain", "flow_gain": "flow"}
"""Effects that are no losses, and their term."""
RECALIBRATION = ("bed", "own")
BEYOND = "beyond"
"""Loss behind the place where the distal pressure is taken: it lowers flow but is no part of the drop to that place."""
OWN_LOSS = (0.0, 4.0, 8.0)
"""Factors of the model's own loss, in prior standard deviations of their logarithm, at which fits begin: recalibration
of a model that lacks a stenosis ends far from its prior, or in a worse optimum."""
NORMAL_90 = 1.6449
CURVATURE_STEP = 3e-4
SLOPE_STEP = float(np.sqrt(np.finfo(float).eps))
ROOT = "root"
MOST_EFFECTIVE = 100
"""Samples that count at most: the error of one law is common to all samples and does not average out over them."""


@dataclass(frozen=True)
class LawFit:
    """Most probable terms of one law; evidence: Schwarz's approximation to the log marginal likelihood.

    point: (k,) where the fit ended, in standard deviations of the priors.
    """

    law: Law
    terms: dict[str, float]
    evidence: float
    rms_ffr: float
    point: tuple[float, ...]

    @property
    def own(self) -> float:
        """How far recalibration has moved the model's own loss, in standard deviations of its prior."""
        return self.point[RECALIBRATION.index("own")]


@dataclass(frozen=True)
class Size:
    """A number and its 90 % interval."""

    value: float
    low: float
    high: float


def predict(branch: Branch, terms: dict[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """FFR, flow and outlet pressure over root pressure, (n,) each, of every sample from simulated outputs alone.

    terms: numbers, or (m, 1) each for m sets side by side, which gives (m, n).

    Solves P_root = z + (own D_0/Q_0 + R + R_end + bed R_bed) Q + S Q^2 per sample: D_0 the simulated drop to the distal
    place, R_end the resistance from there to the outlet (the simulated one and what lies beyond), R_bed the bed's,
    (P_outlet - z) / Q_0, z the zero-flow pressure. The root's is the simulated one times `ROOT`, its mean ratio, of all
    samples unless given. A sensor's offset and gain act on the distal pressure and the flow that are read, and on the
    outlet's pressure where that is the same.
    """
    bed = terms.get("bed", 1.0) * (branch.outlet0 - branch.venous) / branch.flow0
    end = (branch.distal0 - branch.outlet0) / branch.flow0 + terms.get(BEYOND, 0.0)
    series = terms.get("own", 1.0) * branch.drop0 / branch.flow0 + terms.get("linear", 0.0) + end + bed
    root = branch.root0 * terms.get(ROOT, float(np.mean(branch.root3) / np.mean(branch.root0)))
    quadratic, head = terms.get("quadratic", 0.0), root - branch.venous
    # The form without cancellation for a small quadratic loss.
    flow = 2.0 * head / (series + np.sqrt(series**2 + 4.0 * quadratic * head))
    outlet = branch.venous + bed * flow
    distal = outlet + end * flow
    gain, offset = 1.0 + terms.get("gain", 0.0), terms.get("offset", 0.0)
    if branch.one_sensor:
        outlet = gain * outlet + offset
    return (gain * distal + offset) / root, flow * (1.0 + terms.get("flow", 0.0)), outlet / root


def fit_law(branch: Branch, law: Law, rows: np.ndarray) -> LawFit:
    """Most probable terms on chosen samples, the noise of each output unknown, profiled out above its floor.

    Objective: n/2 (log s^2 + mean square / s^2) of FFR, flow and outlet pressure, and the priors, n at most
    `MOST_EFFECTIVE`; k/2 log n per term of the law and log 10 per effect are taken off for the evidence.
    """
    terms, objectives = _posterior(branch, law, rows)

    def with_slope(z):
        steps = SLOPE_STEP * np.maximum(1.0, np.abs(z))
        found = objectives(np.vstack([z, z + np.diag(steps)]))
        return found[0], (found[1:] - found[0]) / steps

    none = np.zeros(len(law.terms))
    starts = [np.r_[0.0, own, 0.0, none] for own in OWN_LOSS]
    starts += [np.r_[0.0, 0.0, 0.0, none + k] for k in (-1.0, 1.0) if law.terms]
    found = [minimize(with_slope, start, method="BFGS", jac=True) for start in starts]
    best = min(found, key=lambda one: one.fun)
    chosen = {name: float(value) for name, value in terms(best.x).items()}
    rms = float(np.sqrt(np.mean((predict(branch, chosen)[0] - branch.distal3 / branch.root3)[rows] ** 2)))
    weight = min(int(rows.sum()), MOST_EFFECTIVE)
    evidence = -float(best.fun) - 0.5 * len(law.terms) * np.log(weight) - len(law.effects) * np.log(10.0)
    return LawFit(law, chosen, evidence, rms, tuple(best.x))


def _posterior(branch: Branch, law: Law, rows: np.ndarray):
    """Terms of a point z of independent standard normal priors, and what a fit minimises at points (m, k), (m,)."""
    ffr = branch.distal3 / branch.root3
    names = [*RECALIBRATION, BEYOND, *law.terms]
    root = float(branch.root3[rows].mean() / branch.root0[rows].mean())
    weight = min(int(rows.sum()), MOST_EFFECTIVE)
    scale = {
        "linear": branch.root0.mean() / branch.flow0.mean(),
        "quadratic": branch.root0.mean() / branch.flow0.mean() ** 2,
        BEYOND: branch.root0.mean() / branch.flow0.mean(),
        "offset": SD_OFFSET * branch.root0.mean(),
        "gain": SD_GAIN,
        "flow": SD_GAIN,
    }

    def terms(z):
        found = {ROOT: root}
        for name, value in zip(names, z, strict=True):
            if name in RECALIBRATION:
                found[name] = np.exp(SD_RECALIBRATION * value)
            elif name == BEYOND:
                found[name] = scale[name] * MEDIAN_BEYOND * np.exp(SD_LOSS * value)
            elif name in LOSSES:
                found[name] = scale[name] * MEDIAN_LOSS * np.exp(SD_LOSS * value)
            else:
                found[name] = scale[name] * value
        return found

    def objectives(points):
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
    """Each term of a fitted law, and each of its effects over the root's mean pressure, with 90 % intervals.

    Laplace's: the curvature of what the fit minimises, at its optimum, and no wider than the prior; of a loss on the
    scale of logarithms. The zero-flow pressure, which a fit takes as known, adds what it moves the optimum by. An
    effect's size needs no unit: the share of the root's mean simulated pressure that a loss takes at the mean simulated
    flow, or that an offset adds; of a gain itself.
    """
    terms, objectives = _posterior(branch, fit.law, rows)
    z = np.array(fit.point)
    steps = CURVATURE_STEP * np.eye(len(z))
    around = [z + s * a + t * b for a in steps for b in steps for s in (1, -1) for t in (1, -1)]
    mixed = objectives(np.array(around)).reshape(len(z), len(z), 4) @ [1.0, -1.0, -1.0, 1.0]
    values, vectors = np.linalg.eigh(mixed / (2.0 * CURVATURE_STEP) ** 2)
    covariance = vectors @ np.diag(1.0 / np.maximum(values, 1.0)) @ vectors.T

    def slopes(venous):
        _, of = _posterior(replace(branch, venous=venous), fit.law, rows)
        return (of(z + steps) - of(z - steps)) / (2.0 * CURVATURE_STEP)

    moved = [slopes(branch.venous + s * branch.venous_sd) for s in (0.5, -0.5)]
    shift = covariance @ (moved[0] - moved[1])
    covariance = covariance + np.outer(shift, shift)

    def interval(of, positive):
        def on_scale(point):
            value = of(terms(point))
            return np.log(value) if positive else value

        slope = np.array([on_scale(z + step) - on_scale(z - step) for step in steps]) / (2.0 * CURVATURE_STEP)
        half = NORMAL_90 * np.sqrt(slope @ covariance @ slope)
        ends = (on_scale(z), on_scale(z) - half, on_scale(z) + half)
        return Size(*(float(np.exp(end) if positive else end) for end in ends))

    found = {name: interval(lambda t, name=name: t[name], name in LOSSES) for name in fit.law.terms}
    flow, root = float(branch.flow0.mean()), float(branch.root0.mean())
    for name in fit.law.effects:
        if name not in SENSORS:
            found[name] = interval(
                lambda t: (t.get("linear", 0.0) * flow + t.get("quadratic", 0.0) * flow**2) / root, True
            )
        else:
            over = root if SENSORS[name] == "offset" else 1.0
            found[name] = interval(lambda t, name=name, over=over: t[SENSORS[name]] / over, False)
    return found


def fit_laws(branch: Branch, rows: np.ndarray, laws: tuple[Law, ...] = LAWS) -> list[LawFit]:
    """Laws on chosen samples (n,) bool, best first."""
    return sorted((fit_law(branch, law, rows) for law in laws), key=lambda fit: -fit.evidence)
