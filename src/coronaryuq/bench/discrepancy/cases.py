"""Cells of the discrepancy benchmark: hidden effects, their strengths, and the noise of the measurements."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from coronaryuq.bench.discrepancy.hidden_cases import OUTSIDE, OUTSIDE_LOOP, WITH_STENOSIS
from coronaryuq.bench.discrepancy.set_aside import EFFECTS
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.discrepancy.hidden.make_case import Noise
from coronaryuq.discrepancy.hidden.nature import Nature
from coronaryuq.zerod.effects.library import LIBRARY

STRENGTHS = {"weak": (-1.0, 0.6), "medium": (0.0, 1.2), "strong": (1.0, 2.0)}
"""Sizes in prior standard deviations: of positive sizes, and the magnitude of signed ones."""
TRACE = "trace "
"""Start of the strength of a case whose size was scaled to a given trace, such as "trace 10"."""
NOISES = {
    "half": Noise(scale=0.5),
    "nominal": Noise(),
    "double": Noise(scale=2.0),
    "underestimated": Noise(stated=2.0 / 3.0),
    "correlated": Noise(correlation=0.7),
    "violated": Noise(stated=0.7, correlation=0.5),
}
VIOLATED_VESSELS, VIOLATED_BEDS = 0.15, 0.2
"""Spreads of the truth under the noise "violated"."""
NOTHING_PER_SEED = 5
"""Cases without a hidden effect per seed: such a search is short, and a small rate needs many."""
PAIRS_OF_TWO = (
    ("quadratic_stenosis", "pressure_offset"),
    ("diffuse_narrowing", "mbf_underestimation"),
    ("diffuse_narrowing", "pressure_gain"),
    ("intramyocardial_pressure", "quadratic_stenosis"),
    ("intramyocardial_pressure", "intramyocardial_delay"),
    ("back_pressure", "flow_gain"),
)
LOOP_PAIRS = (("quadratic_stenosis", "pressure_offset"), ("intramyocardial_pressure", "diffuse_narrowing"))


@dataclass(frozen=True)
class Case:
    """One case. effects: names; places are drawn by `seed`. known: with a stenosis that is in the model."""

    effects: tuple[str, ...]
    strength: str
    noise: str
    seed: int
    outside: str = ""
    known: bool = False

    @property
    def trace(self) -> float | None:
        """The trace that the size is scaled to."""
        return float(self.strength.removeprefix(TRACE)) if self.strength.startswith(TRACE) else None

    def nature(self, usual: Nature) -> Nature:
        """Return the nature of the case's truth."""
        violated = replace(usual, vessels=VIOLATED_VESSELS, beds=VIOLATED_BEDS, parts=VIOLATED_BEDS)
        return violated if self.noise == "violated" else usual

    @property
    def key(self) -> tuple:
        return self.label, self.strength, self.noise, self.seed

    @property
    def label(self) -> str:
        return f"outside:{self.outside}" if self.outside else "+".join(self.effects) or "none"


def open_loop_cases(quick: bool, seeds: range, strengths: Sequence[str], noises: Sequence[str]) -> Iterator[Case]:
    """Yield the cases on the open loop: three if quick, else every effect of the library and the special cells."""
    if quick:
        yield Case((), "none", "nominal", 1)
        yield Case(("quadratic_stenosis",), "medium", "nominal", 2)
        yield Case((), "medium", "nominal", 3, "bulging_territory")
        return
    for seed in seeds:
        for noise in noises:
            for number in range(NOTHING_PER_SEED):
                yield Case((), "none", noise, seed + 1000 * number)
            for strength in strengths:
                for hidden in LIBRARY:
                    yield Case((hidden.name,), strength, noise, seed)
        for noise in _special_noises(noises):
            for name in OUTSIDE:
                yield Case((), "medium", noise, seed, name)
            for pair in PAIRS_OF_TWO:
                yield Case(pair, "medium", noise, seed)


def _special_noises(noises: Sequence[str]) -> list[str]:
    """Noises under which pairs and effects outside the library are hidden: all except other scales."""
    return [noise for noise in noises if noise not in ("half", "double")] or ["nominal"]


def closed_loop_cases(seeds: range, strengths: Sequence[str], noises: Sequence[str]) -> Iterator[Case]:
    """Yield the cases on a closed loop: none, every effect of the library, pairs, effects outside the library."""
    for seed in seeds:
        for noise in noises:
            yield Case((), "none", noise, seed)
            for strength in strengths:
                for hidden in LIBRARY:
                    if hidden.name not in WITH_STENOSIS:
                        yield Case((hidden.name,), strength, noise, seed)
        for name in (name for name in WITH_STENOSIS if name not in OUTSIDE_LOOP):
            yield Case((name,), "strong", "half", seed, known=True)
        for name in OUTSIDE_LOOP:
            known = name in WITH_STENOSIS
            yield Case((), "medium", "half" if known else "nominal", seed, name, known)
        for pair in LOOP_PAIRS:
            yield Case(pair, "medium", "nominal", seed)


def set_aside_cases(path: str | Path) -> Iterator[Case]:
    """Yield the cases of a file of effects set aside: `effects`, `first_seed` and `seeds`.

    Raises
    ------
    InputError
        For an unknown effect.
    """
    chosen = read_json(path, ("effects", "first_seed", "seeds"))
    for name in chosen["effects"]:
        if name not in EFFECTS:
            raise InputError(path, "effects", name, f"no effect set aside; known: {', '.join(EFFECTS)}")
    for seed in range(chosen["first_seed"], chosen["first_seed"] + chosen["seeds"]):
        for name in chosen["effects"]:
            yield Case((), "medium", "nominal", seed, name)


def check_cells(wanted: Sequence[str], cells: list[str]) -> None:
    """Raise `InputError` for a label that is not among `cells`."""
    for label in wanted:
        if label not in cells:
            remedy = f"no cell of this benchmark; known: {', '.join(dict.fromkeys(cells))}"
            raise InputError("bench discrepancy", "--effects", label, remedy)
