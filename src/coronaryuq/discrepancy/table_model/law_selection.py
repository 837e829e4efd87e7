"""Which effects are part of a table model's law, and which of them its samples cannot tell apart."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.discrepancy.table_model.laws import FLOOR_FFR, SENSORS, LawFit

LEAST_INCLUSION = 0.9
"""Posterior probability from which an effect, or what the samples cannot tell from it, is part of the law."""
SHRUNK = -3.0
"""Prior standard deviations by which the model's own loss may be lessened; farther is no recalibration."""
ODDS_OF_CLASS = 20.0
"""Odds within which an effect that takes another's place in a law is of its class, as in the search on networks."""


@dataclass(frozen=True)
class Class:
    """Effects that the samples cannot tell apart, the best first, and the probability that one of them is there."""

    members: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class Choice:
    """The fitted law that is answered, and the class of each of its effects, in their order."""

    fit: LawFit
    classes: tuple[Class, ...]


def inclusion(ranked: list[LawFit]) -> dict[str, float]:
    """Posterior probability that each effect is part of the law, over all laws."""
    names = dict.fromkeys(name for fit in ranked for name in fit.law.effects)
    return {name: _with_any(ranked, {name}) for name in names}


def _weights(ranked: list[LawFit]) -> np.ndarray:
    weights = np.exp([fit.evidence - ranked[0].evidence for fit in ranked])
    return weights / weights.sum()


def _with_any(ranked: list[LawFit], names) -> float:
    """Posterior probability that one at least of these effects is part of the law."""
    pairs = zip(_weights(ranked), ranked, strict=True)
    return float(sum(weight for weight, fit in pairs if set(names) & set(fit.law.effects)))


def _classes(ranked: list[LawFit], named: tuple[str, ...]) -> list[Class]:
    """Of each named effect: itself, and those that take its place in laws within `ODDS_OF_CLASS` of theirs."""
    weight = dict.fromkeys((fit.law.effects for fit in ranked), 0.0)
    for one, fit in zip(_weights(ranked), ranked, strict=True):
        weight[fit.law.effects] += one
    found = []
    for k, name in enumerate(named):
        instead = {other[k]: w for other, w in weight.items() if _replaces(other, named, k) and other[k] != name}
        rivals = [r for r, w in instead.items() if ODDS_OF_CLASS * w >= weight[named]]
        members = (name, *sorted(rivals, key=lambda r: -instead[r]))
        found.append(Class(members, _with_any(ranked, members)))
    return found


def _replaces(other: tuple[str, ...], named: tuple[str, ...], k: int) -> bool:
    return len(other) == len(named) and other[:k] == named[:k] and other[k + 1 :] == named[k + 1 :]


def choose(ranked: list[LawFit]) -> Choice:
    """The best law without what is no part of it with probability `LEAST_INCLUSION`, and what the samples take for it.

    The probability is that of the effect's class: where two sensors share the law between them, one of the two is part
    of it. A sensor's error is left out as well where the loss beside it alone, or recalibration, leaves less than
    `FLOOR_FFR`, and the model's own loss where it was: a loss of the model that differs in its form is as likely.
    """
    fit = ranked[0]
    while True:
        classes = _classes(ranked, fit.law.effects)
        doubtful = [k for k, one in enumerate(classes) if one.probability < LEAST_INCLUSION]
        if not doubtful and classes and fit.law.effects[-1] in SENSORS:
            alone = next(one for one in ranked if one.law.effects == fit.law.effects[:-1])
            doubtful = [len(classes) - 1] if alone.rms_ffr < FLOOR_FFR and alone.own > SHRUNK else []
        if not doubtful:
            return Choice(fit, tuple(classes))
        least = min(doubtful, key=lambda k: classes[k].probability)
        kept = [one.members for k, one in enumerate(classes) if k != least]
        fit = next(one for one in ranked if is_one_of(one.law.effects, kept))


def is_one_of(effects: tuple[str, ...], classes: list[tuple[str, ...]]) -> bool:
    """Whether a law's effects are one of each class, in their order."""
    return len(effects) == len(classes) and all(e in members for e, members in zip(effects, classes, strict=True))
