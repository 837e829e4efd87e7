"""What a campaign adopts of the answer of a search, and why not if it adopts nothing."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from coronaryuq.discrepancy.selection.answer import NAMES

ENOUGH = 0.99
"""Share of a class's probability that its adopted members have; the least probable others are left out."""
ADOPTED_FROM = 0.8
"""Probability of the names from which they are adopted: a wrong one costs the prediction four times a missing one."""
DENSITY = "log_predictive_density_per_row"


@dataclass(frozen=True)
class Placed:
    """A member of a class: effect, place, probability within the class, and its sizes in standard deviations.

    mean (k,), covariance (k, k). measurement: whether it is an error of a sensor.
    """

    effect: str
    place: str
    probability: float
    measurement: bool
    mean: list[float]
    covariance: list[list[float]]

    @property
    def label(self) -> str:
        return f"{self.effect.replace('_', ' ')} at {self.place}"


@dataclass(frozen=True)
class Choice:
    """Classes of effects that data cannot distinguish, the most probable member first; reason: why there is none."""

    classes: list[list[Placed]]
    reason: str = ""


def chosen(answer: Mapping[str, Any]) -> Choice:
    """Return what is adopted of `discrepancy.json`: probable names that improve the prediction of data held out."""
    given, probabilities = (answer["facts"]["answer"][key] for key in ("given", "probabilities"))
    if not answer["named"]:
        return Choice([], f"the answer of the search is “{given}”, which names no effect")
    if probabilities[NAMES] < ADOPTED_FROM:
        return Choice(
            [],
            f"what the search named has a probability of {probabilities[NAMES]:.2f}, and is adopted from "
            f"{ADOPTED_FROM:.2f} on",
        )
    before, after = (answer["held_out"][when][DENSITY] for when in ("before", "after"))
    if not after > before:
        return Choice(
            [],
            "what the search named does not improve the prediction of the data held out (log density per value "
            f"{after:.2f} with it, {before:.2f} without)",
        )
    return Choice([_members(entry["class"]) for entry in answer["named"]])


def _members(entries: list[Mapping[str, Any]]) -> list[Placed]:
    ranked = sorted(entries, key=lambda one: -one["probability"])
    total, kept, reached = sum(one["probability"] for one in ranked), [], 0.0
    for one in ranked:
        kept.append(one)
        reached += one["probability"]
        if reached >= ENOUGH * total:
            break
    return [
        Placed(
            one["effect"], one["place"], one["probability"] / reached, one["side"] == "measurement",
            one["standard_sizes"]["mean"], one["standard_sizes"]["covariance"],
        )
        for one in kept
    ]  # fmt: skip
