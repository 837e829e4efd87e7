"""Cells of the discrepancy benchmark: hidden effects, their strengths, and the noise of the measurements."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from coronaryuq.bench.discrepancy.hidden_cases import OUTSIDE, OUTSIDE_LOOP, WITH_STENOSIS
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.hidden.make_case import Noise
from coronaryuq.zerod.effects.library import LIBRARY

STRENGTHS = {"weak": (-1.0, 0.6), "medium": (0.0, 1.2), "strong": (1.0, 2.0)}
"""Sizes in prior standard deviations: of positive sizes, and the magnitude of signed ones."""
NOISES = {
    "half": Noise(scale=0.5),
    "nominal": Noise(),
    "double": Noise(scale=2.0),
    "underestimated": Noise(stated=2.0 / 3.0),
    "correlated": Noise(correlation=0.7),
}
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


def check_cells(wanted: Sequence[str], cells: list[str]) -> None:
    """Raise `InputError` for a label that is not among `cells`."""
    for label in wanted:
        if label not in cells:
            remedy = f"no cell of this benchmark; known: {', '.join(dict.fromkeys(cells))}"
            raise InputError("bench discrepancy", "--effects", label, remedy)
