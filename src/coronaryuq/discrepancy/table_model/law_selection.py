"""Selection of the effects in a table model's law, and of those that its samples cannot distinguish."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from coronaryuq.discrepancy.table_model.laws import FLOOR_FFR, SENSORS, LawFit

LEAST_INCLUSION = 0.9
"""Posterior probability above which an effect, or one indistinguishable from it, is part of the law."""
SHRUNK = -3.0
"""Prior standard deviations by which the model's own loss may be reduced; more is implausible for recalibration."""
ODDS_OF_CLASS = 20.0
"""Odds within which an effect that replaces another in a law belongs to its class, as in the search on networks."""


@dataclass(frozen=True)
class EffectClass:
    """Indistinguishable effects, best first, and the probability that one of them is present."""

    members: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class Choice:
    """The selected law, and the class of each of its effects in their order."""

    fit: LawFit
    classes: tuple[EffectClass, ...]


def inclusion(ranked: list[LawFit]) -> dict[str, float]:
    """Return the posterior probability of each effect, over all laws."""
    names = dict.fromkeys(name for fit in ranked for name in fit.law.effects)
    return {name: _probability_of_any(ranked, {name}) for name in names}


def _weights(ranked: list[LawFit]) -> np.ndarray:
    weights = np.exp([fit.evidence - ranked[0].evidence for fit in ranked])
    return weights / weights.sum()


def _probability_of_any(ranked: list[LawFit], names: Collection[str]) -> float:
    pairs = zip(_weights(ranked), ranked, strict=True)
    return float(sum(weight for weight, fit in pairs if set(names) & set(fit.law.effects)))


def _classes(ranked: list[LawFit], named: tuple[str, ...]) -> list[EffectClass]:
    """For each named effect, itself and those that replace it in laws within `ODDS_OF_CLASS`."""
    weights = dict.fromkeys((fit.law.effects for fit in ranked), 0.0)
    for weight, fit in zip(_weights(ranked), ranked, strict=True):
        weights[fit.law.effects] += weight
    classes = []
    for k, name in enumerate(named):
        alike = (other for other in weights if len(other) == len(named) and other[k] != name)
        replaced = {other[k]: weights[other] for other in alike if (*other[:k], name, *other[k + 1 :]) == named}
        rivals = [r for r, w in replaced.items() if ODDS_OF_CLASS * w >= weights[named]]
        members = (name, *sorted(rivals, key=lambda r: -replaced[r]))
        classes.append(EffectClass(members, _probability_of_any(ranked, members)))
    return classes


def choose(ranked: list[LawFit]) -> Choice:
    """Select the best law after dropping effects whose class is less probable than `LEAST_INCLUSION`.

    A sensor's error is dropped as well if the loss without it, or recalibration, leaves less than `FLOOR_FFR` and the
    model's own loss is plausible: a slightly different form of the model's loss is then as likely.
    """
    fit = ranked[0]
    while True:
        classes = _classes(ranked, fit.law.effects)
        doubtful = [k for k, one in enumerate(classes) if one.probability < LEAST_INCLUSION]
        if not doubtful and classes and fit.law.effects[-1] in SENSORS:
            without = next(other for other in ranked if other.law.effects == fit.law.effects[:-1])
            doubtful = [len(classes) - 1] if without.rms_ffr < FLOOR_FFR and without.own > SHRUNK else []
        if not doubtful:
            return Choice(fit, tuple(classes))
        least = min(doubtful, key=lambda k: classes[k].probability)
        kept = [one.members for k, one in enumerate(classes) if k != least]
        fit = next(other for other in ranked if is_one_of(other.law.effects, kept))


def is_one_of(effects: tuple[str, ...], classes: list[tuple[str, ...]]) -> bool:
    """Whether a law's effects are one from each class, in their order."""
    return len(effects) == len(classes) and all(e in members for e, members in zip(effects, classes, strict=True))
