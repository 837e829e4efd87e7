"""Facts for the summary of a search, as JSON; `summary_text` and `phrases` word them."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PlacedEffect
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.inference.locate import Located
from coronaryuq.discrepancy.selection.discovery import Discovery
from coronaryuq.discrepancy.selection.size_constancy import Constancy
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Z_90, Parameter
from coronaryuq.zerod.effects.sensors import Offset

WHERE = ("quantity", "location", "condition")


def facts(discovery: Discovery) -> dict:
    """Return the facts about a search that are not in its tables and named effects.

    Returns
    -------
    dict
        measurements: number of fitted ones. scatter: quantity → sum of squares of the residuals of the recalibrated
        model, and the one that the stated noise leads to. waveforms: whether there are any. driven: by a measured
        pressure or flow. worst: the group with the largest misfit. best: the effects of the best hypothesis, named or
        not. answer: the answer given, and the probabilities of all. unexplained: whether a misfit remains.
    """
    problem, located, answer = discovery.problem, discovery.located, discovery.answer
    return {
        "measurements": len(discovery.base.residual),
        "scatter": _scatter(discovery),
        "waveforms": any(series.time is not None for series in problem.forward.measured),
        "driven": not problem.forward.anatomy.closed_loop,
        "worst": next(({name: getattr(group, name) for name in WHERE} for group in located.groups), None),
        "best": [_described(discovery, placed) for placed in discovery.hypothesis],
        "answer": {
            "given": answer.given,
            "probabilities": answer.probabilities,
            "forms_of_something_else": answer.forms,
            "leading_form": answer.leading_form,
            "shows_in": [
                dict(zip((*WHERE, "probability"), (*where, p), strict=True)) for where, p in answer.shown.items()
            ],
            "device": answer.device,
            "picked_up": answer.picked_up,
            "support_nats": answer.support,
        },
        "unexplained": bool(discovery.remaining.alarm(problem.settings.alarm_level)),
    }


def _scatter(discovery: Discovery) -> dict[str, list[float]]:
    """Return `scatter` of `facts`."""
    problem, fit = discovery.problem, discovery.base
    explained = np.linalg.solve(np.linalg.cholesky(fit.precision), fit.jacobian.T)
    # The covariance of the residuals of a linear model, with its priors, is what it leaves of the noise.
    each = np.array([fit.residual**2, 1.0 - (explained**2).sum(axis=0)])
    quantity = np.array([series.quantity for series in problem.forward.measured])[problem.owner][problem.train]
    return {name: each[:, quantity == name].sum(axis=1).tolist() for name in dict.fromkeys(quantity.tolist())}


def _described(discovery: Discovery, placed: PlacedEffect) -> dict:
    forward = discovery.problem.forward
    effect, anatomy = placed.effect, forward.anatomy
    beyond = []
    for parameter in discovery.beyond_prior(placed):
        bounds = (float(parameter.from_standard(k * RULE.prior_bound)) for k in (-1, 1))
        low, high = sorted(float(effect.describe(parameter, bound, anatomy)[1]) for bound in bounds)
        beyond.append({"label": _size_label(placed, parameter, anatomy), "low": low, "high": high})
    return {
        "effect": effect.name,
        "place": placed.place,
        "sizes": in_clinical_units(placed, described_sizes(placed, discovery.sizes(placed), anatomy), forward.measured),
        "beyond_prior": beyond,
        "implausible": placed in discovery.answer.implausible,
        "varying": next((by_condition(v, forward) for v in discovery.answer.varying if v.placed == placed), None),
        "assumption": effect.assumption(anatomy, [c.covariates for c in forward.conditions.values()]),
    }


def described_sizes(placed: PlacedEffect, sizes: list[tuple[Parameter, float, float]], anatomy: Anatomy) -> list[dict]:
    """Return the sizes (parameter, z, standard deviation of z) as the effect describes them, with 90 % intervals.

    A negative delay of a sensor is given by its absolute value, as `early`.
    """
    described, effect = [], placed.effect
    for parameter, z, sd in sizes:
        values = parameter.with_interval(z, sd)
        meaning, _ = effect.describe(parameter, values[0], anatomy)
        value, *ends = (float(effect.describe(parameter, size, anatomy)[1]) for size in values)
        low, high = sorted(ends)
        early = effect.side == "measurement" and parameter.name == "delay" and value < 0.0
        if early:
            value, low, high = -value, -high, -low
        described.append({"meaning": meaning, "value": value, "low": low, "high": high, "early": early})
    return described


def in_clinical_units(placed: PlacedEffect, described: list[dict], measured: Sequence[Measured]) -> list[dict]:
    """Return the offset of a sensor in mmHg or mL/min, not over the scale of its readings; other sizes as they are."""
    if not (found := _clinical(placed, measured)):
        return described
    (size,), (meaning, factor) = described, found
    return [size | {"meaning": meaning} | {key: size[key] * factor for key in ("value", "low", "high")}]


def _clinical(placed: PlacedEffect, measured: Sequence[Measured]) -> tuple[str, float] | None:
    """Return what the offset of a sensor is, and a size of 1 in that unit; None for other effects."""
    return placed.effect.clinical(placed.place, measured) if isinstance(placed.effect, Offset) else None


SMALL = 1e-6
"""Step of z by which a slope is computed."""


def by_condition(varying: Constancy, forward: Forward) -> dict:
    """Return the first size under each condition that determines it, with 90 % intervals.

    The model is linear in the size, not in its logarithm: under one condition the effect may be absent. Of an effect
    whose shape changes with its size, the logarithm is as good.
    """
    anatomy = forward.anatomy
    effect, parameter = varying.placed.effect, varying.placed.effect.parameters[0]
    size, further = (float(parameter.from_standard(z)) for z in (varying.about, varying.about + SMALL))
    slope, least, sizes = (further - size) / SMALL, 0.0 if parameter.kind == "lognormal" else -np.inf, {}
    for condition, (mean, sd) in varying.known.items():
        each = [max(size + slope * (mean + k * sd - varying.about), least) for k in (0.0, -Z_90, Z_90)]
        each = parameter.with_interval(mean, sd) if effect.changes_shape else each
        sizes[condition] = [float(effect.describe(parameter, one, anatomy)[1]) for one in each]
    own = _size_label(varying.placed, parameter, anatomy), 1.0
    label, factor = _clinical(varying.placed, forward.measured) or own
    ordered = {condition: [value, *sorted(ends)] for condition, (value, *ends) in sizes.items()}
    sizes = {condition: [factor * value for value in values] for condition, values in ordered.items()}
    return {"label": label, "unit": "" if parameter.unit == "1" else parameter.unit, "conditions": sizes}


def _size_label(placed: PlacedEffect, parameter: Parameter, anatomy: Anatomy) -> str:
    """Return a short name of a size: the parameter's, unless the effect describes it differently in this network.

    An offset is given in another unit beside it, and says what it is relative to.
    """
    meaning, _ = placed.effect.describe(parameter, float(parameter.from_standard(0.0)), anatomy)
    short = meaning == parameter.meaning and not isinstance(placed.effect, Offset)
    return parameter.name.replace("_", " ") if short else meaning


def prior_conflicts(located: Located, nuisances: list[Nuisance], level: float) -> list[dict]:
    """Return nuisance parameters in conflict with their prior at `level` or far outside it, with their factors."""
    sd = {nuisance.name: nuisance.sd for nuisance in nuisances}
    conflicts = [one for one in located.conflicts if one.p < level or abs(one.moved) > RULE.distorted]
    return [vars(one) | {"factor": float(np.exp(sd[one.name] * one.moved))} for one in conflicts]
