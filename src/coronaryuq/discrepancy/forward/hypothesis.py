"""Hypotheses: missing effects, each at its place, and the positions of their sizes in the parameters z."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from coronaryuq.zerod.effects.base import Effect, Parameter

APART = ("collateral", "distal_collateral", "side_branch", "misattached_branch", "subdivision")
"""Effects of which at most `MANY` share a network, without others."""
MANY = 20
"""Collaterals between all pairs of outlets would couple all vessels, and beds or parts of all vessels slow all runs."""


Sizes = list[dict[str, float]]
"""Sizes of each effect of a hypothesis by name, in the units of its parameters."""


class PlacedEffect(NamedTuple):
    """An effect at a place of the network."""

    effect: Effect
    place: str

    @property
    def key(self) -> tuple[str, str]:
        """Names of the effect and of its place."""
        return self.effect.name, self.place


@dataclass(frozen=True)
class Hypothesis:
    """The effects of a model in addition to its nuisance parameters; empty for the unmodified model.

    Also the layout of the parameter vector z (p,), standard normal a priori: the nuisance parameters first, then the
    sizes of each effect in turn. Because the sizes come last, the number of nuisance parameters is not needed.
    """

    effects: tuple[PlacedEffect, ...] = ()

    def __iter__(self) -> Iterator[PlacedEffect]:
        return iter(self.effects)

    def __len__(self) -> int:
        return len(self.effects)

    @property
    def parameters(self) -> list[Parameter]:
        """Parameters of all effects, in the order of their sizes in z."""
        return [parameter for effect, _ in self.effects for parameter in effect.parameters]

    def with_(self, placed: PlacedEffect) -> "Hypothesis":
        """Add an effect; its sizes come last in z."""
        return Hypothesis((*self.effects, placed))

    def without(self, placed: PlacedEffect) -> "Hypothesis":
        """Remove an effect."""
        return Hypothesis(tuple(other for other in self.effects if other != placed))

    def nuisances(self, z: np.ndarray) -> np.ndarray:
        """Return the nuisance parameters of z (p,)."""
        return z[: len(z) - len(self.parameters)]

    def columns(self, z: np.ndarray, placed: PlacedEffect) -> slice:
        """Return the positions of the sizes of an effect in z (p,)."""
        later = self.effects[self.effects.index(placed) :]
        first = len(z) - sum(len(effect.parameters) for effect, _ in later)
        return slice(first, first + len(placed.effect.parameters))

    def columns_of(self, z: np.ndarray, kept: "Hypothesis") -> np.ndarray:
        """Return the positions in z (p,) of the nuisance parameters and of those of its effects that are kept."""
        gone = [np.r_[self.columns(z, placed)] for placed in self if placed not in kept]
        return np.delete(np.arange(len(z)), np.concatenate([np.zeros(0, dtype=int), *gone]))

    def sizes(self, z: np.ndarray, placed: PlacedEffect) -> np.ndarray:
        """Return the sizes of an effect in z (p,), in standard deviations of their priors."""
        return z[self.columns(z, placed)]

    def physical_sizes(self, z: np.ndarray) -> Sizes:
        """Return for each effect its sizes in z (p,) by name, in the units of its parameters."""
        return [
            {
                parameter.name: float(parameter.from_standard(size))
                for parameter, size in zip(placed.effect.parameters, self.sizes(z, placed), strict=True)
            }
            for placed in self.effects
        ]

    def on_network(self, sizes: Sizes) -> list[tuple]:
        """Return names, places and sizes of the effects on the network."""
        pairs = zip(self, sizes, strict=True)
        return [(*placed.key, *own.values()) for placed, own in pairs if placed.effect.side == "network"]

    def all_sizes(self, z: np.ndarray) -> np.ndarray:
        """Return the sizes of all effects in z (p,)."""
        return z[len(z) - len(self.parameters) :]

    def at_prior_mean(self, z: np.ndarray) -> np.ndarray:
        """Return z (p,) with its sizes and the nuisance parameters at their prior mean."""
        return np.concatenate([np.zeros(len(self.nuisances(z))), self.all_sizes(z)])

    def drop(self, z: np.ndarray, placed: PlacedEffect) -> np.ndarray:
        """Return z (p,) without the sizes of an effect."""
        return np.delete(z, self.columns(z, placed))

    def without_measurement_errors(self, z: np.ndarray) -> tuple[np.ndarray, "Hypothesis"]:
        """Return z (p,) and the hypothesis without the effects on measurements, which another instrument lacks."""
        left = self
        for placed in self:
            if placed.effect.side == "measurement":
                z, left = left.drop(z, placed), left.without(placed)
        return z, left


PLAIN = Hypothesis()
"""The unmodified model, without any effect."""


def shared_grafts(grafts: list[PlacedEffect]) -> dict[PlacedEffect, list[PlacedEffect]]:
    """Map each graft to all grafts in the same network: those on one side of the probes, or some of one effect."""
    kinds = [(one.effect.beyond_probes, one.effect.name in APART and one.effect.name) for one in grafts]
    shares: dict[tuple, list[PlacedEffect]] = {}
    for number, (one, kind) in enumerate(zip(grafts, kinds, strict=True)):
        turn = kinds[:number].count(kind) // MANY if kind[1] else 0
        shares.setdefault((kind, turn), []).append(one)
    return {one: share for share in shares.values() for one in share}
