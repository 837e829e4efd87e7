"""Laws of pressure loss in a branch of a table model: what each predicts, its fit, and which effects are part of it."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from coronaryuq.discrepancy.tables import Branch

LEAST_INCLUSION = 0.9
"""Posterior probability from which an effect is part of the law."""
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
LOSSES = ("linear", "quadratic")
RECALIBRATION = ("bed", "own")
BEYOND = "beyond"
"""Loss behind the place where the distal pressure is taken: it lowers flow but is no part of the drop to that place."""
OWN_LOSS = (0.0, 4.0, 8.0)
"""Factors of the model's own loss, in prior standard deviations of their logarithm, at which fits begin: recalibration
of a model that lacks a stenosis ends far from its prior, or in a worse optimum."""
SLOPE_STEP = float(np.sqrt(np.finfo(float).eps))
ROOT = "root"
MOST_EFFECTIVE = 100
"""Samples that count at most: the error of one law is common to all samples and does not average out over them."""


@dataclass(frozen=True)
class LawFit:
    """Most probable terms of one law; evidence: Schwarz's approximation to the log marginal likelihood."""

    law: Law
    terms: dict[str, float]
    evidence: float
    rms_ffr: float


def predict(branch: Branch, terms: dict[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """FFR, flow and outlet pressure over root pressure, (n,) each, of every sample from simulated outputs alone.

    terms: numbers, or (m, 1) each for m sets side by side, which gives (m, n).

    Solves P_root = z + (own D_0/Q_0 + R + R_end + bed R_bed) Q + S Q^2 per sample: D_0 the simulated drop to the distal
    place, R_end the resistance from there to the outlet (the simulated one and what lies beyond), R_bed the bed's,
    (P_outlet - z) / Q_0, z the zero-flow pressure. The root's is the simulated one times `ROOT`, its mean ratio, of all
    samples unless given. A sensor's offset and gain act on the distal
    pressure and the flow that are read.
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
    read = distal * (1.0 + terms.get("gain", 0.0)) + terms.get("offset", 0.0)
    return read / root, flow * (1.0 + terms.get("flow", 0.0)), outlet / root


def fit_law(branch: Branch, law: Law, rows: np.ndarray) -> LawFit:
    """Most probable terms on chosen samples, the noise of each output unknown, profiled out above its floor.

    Objective: n/2 (log s^2 + mean square / s^2) of FFR, flow and outlet pressure, and the priors, n at most
    `MOST_EFFECTIVE`; k/2 log n per term of the law and log 10 per effect are taken off for the evidence.
    """
    ffr, count = branch.distal3 / branch.root3, int(rows.sum())
    names = [*RECALIBRATION, BEYOND, *law.terms]
    root = float(branch.root3[rows].mean() / branch.root0[rows].mean())
    weight = min(count, MOST_EFFECTIVE)
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
        """At points (m, k) in one go, (m,)."""
        predicted, flow, outlet = predict(branch, terms(points.T[:, :, None]))
        misfit = np.zeros(len(points))
        errors = (predicted - ffr, flow / branch.flow3 - 1.0, outlet - branch.outlet3 / branch.root3)
        for error, floor in zip(errors, (FLOOR_FFR, FLOOR_FLOW, FLOOR_OUTLET), strict=True):
            variance = np.mean(error[:, rows] ** 2, axis=1)
            sd2 = np.maximum(variance, floor**2)
            misfit += 0.5 * weight * (np.log(sd2) + variance / sd2)
        return misfit + 0.5 * np.sum(points**2, axis=1)

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
    rms = float(np.sqrt(np.mean((predict(branch, chosen)[0] - ffr)[rows] ** 2)))
    evidence = -float(best.fun) - 0.5 * len(law.terms) * np.log(weight) - len(law.effects) * np.log(10.0)
    return LawFit(law, chosen, evidence, rms)


def fit_laws(branch: Branch, rows: np.ndarray) -> list[LawFit]:
    """All laws on chosen samples (n,) bool, best first."""
    return sorted((fit_law(branch, law, rows) for law in LAWS), key=lambda fit: -fit.evidence)


def inclusion(ranked: list[LawFit]) -> dict[str, float]:
    """Posterior probability that each effect is part of the law, over all laws."""
    weights = np.exp([fit.evidence - ranked[0].evidence for fit in ranked])
    weights /= weights.sum()
    names = dict.fromkeys(name for fit in ranked for name in fit.law.effects)
    return {
        name: float(sum(w for w, fit in zip(weights, ranked, strict=True) if name in fit.law.effects)) for name in names
    }


def choose(ranked: list[LawFit]) -> LawFit:
    """The best law of exactly those effects that are part of it with probability `LEAST_INCLUSION` at least."""
    chosen = {name for name, probability in inclusion(ranked).items() if probability >= LEAST_INCLUSION}
    return next((fit for fit in ranked if set(fit.law.effects) == chosen), ranked[0])
