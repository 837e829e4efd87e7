"""Hypotheses for tests, written as pairs of an effect, or its name in the library, and a place."""

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.library import effect


def placed(name: str | Effect, place: str) -> PlacedEffect:
    return PlacedEffect(effect(name) if isinstance(name, str) else name, place)


def assume(*effects: tuple[str | Effect, str]) -> Hypothesis:
    return Hypothesis(tuple(placed(*pair) for pair in effects))
