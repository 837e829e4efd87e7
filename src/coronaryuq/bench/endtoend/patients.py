"""Synthetic patients of the benchmark: what is drawn, from which distributions.

Of each pair of a segmented and a true lumen the segmented one is drawn first, and the true one around it by the law
that `case.yaml` states: the radius has the segmented one as its mean. So stated and actual errors have one joint law.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.case.case_json import Branch
from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.case.lumen.law import lumen_law
from coronaryuq.case.network.build import Physics
from coronaryuq.case.settings import MURRAY_EXPONENT
from coronaryuq.core.seeds import generator
from coronaryuq.core.units import BLOOD_VISCOSITY
from coronaryuq.synthetic.anatomy import Anatomy, patient_anatomy
from coronaryuq.synthetic.arteries import PATTERNS, Lesion
from coronaryuq.synthetic.settings import Settings
from coronaryuq.synthetic.truth import HEART

PURPOSE = "endtoend"
LEFT_DOMINANT = 0.15
"""Share of patients."""
NUMBERS = (0.1, 0.35, 0.35, 0.2)
"""Probability of 0 to 3 stenoses, at most one in an artery."""
PLACES = {"LAD": (0.3, 1.4), "LCx": (0.3, 1.9), "RCA": (0.3, 3.5)}
"""Fractional index of an artery's control points, uniform: the proximal segments."""
LEFT_PLACES = {**PLACES, "RCA": (0.3, 1.5)}
LENGTH, REDUCTION = (0.6, 1.2), (0.30, 0.75)
"""cm, and fraction of the diameter at the segmented throat; uniform."""
UNIFORM = {
    "period": (0.75, 1.05),
    "mean_pressure": (82.0, 106.0),
    "stroke_volume": (55.0, 85.0),
    "mbf": (1.2, 2.6),
    "bed_spread": (0.05, 0.20),
    "texture": (0.03, 0.10),
}
"""Settings of `synthetic`, in their units: rhythm, pressure, output, microvasculature."""
MICROVASCULAR = (0.75, 1.10)
"""Relative conductance per gram of the beds of each artery, uniform."""
HEART_SPREAD = 0.08
"""Standard deviation of the logarithm of every parameter of heart and lungs that is positive."""
MODES = 40
"""Coordinates of the true lumen's error in each artery: in effect its exact law, of which a campaign carries three."""
CELLS = 6000


@dataclass(frozen=True)
class Errors:
    """Standard deviations of all measurements and assumptions, as `case.yaml` states them. noise: factor on all."""

    lumen: LumenError
    routine: RoutineErrors
    noise: float

    @classmethod
    def scaled(cls, noise: float) -> "Errors":
        """Return the defaults of `case.yaml` times `noise`."""
        lumen, routine = LumenError(), RoutineErrors()
        radius = {name: noise * getattr(lumen, name) for name in ("common_sd", "local_sd")}
        kept = {"pressure_correlation", "microvascular", "microvascular_correlation"}  # no errors of measurement
        others = {name: noise * value for name, value in routine.model_dump().items() if name not in kept}
        return cls(lumen.model_copy(update=radius), routine.model_copy(update=others), noise)


@dataclass(frozen=True)
class Drawn:
    """One patient before any simulation.

    segmented, true: anatomies that differ in their radii. physics: blood, heart and Murray's exponent of the truth.
    settings: of the truth, hyperaemia included.
    """

    index: int
    seed: int
    dominance: str
    lesions: tuple[Lesion, ...]
    segmented: Anatomy
    true: Anatomy
    settings: Settings
    physics: Physics
    errors: Errors

    def stated(self) -> dict:
        """Return what was drawn, for a line of results."""
        settings = self.settings.model_dump()
        return {
            "dominance": self.dominance,
            "stenoses": {lesion.name: {"reduction": lesion.reduction} for lesion in self.lesions},
            **{name: settings[name] for name in (*UNIFORM, "hyperaemia", "microvascular", "anatomy_seed")},
            "viscosity": self.physics.viscosity,
        }


def draw(seed: int, index: int, noise: float = 1.0) -> Drawn:
    """Draw patient `index`; it depends on the seed and the index alone, and every choice has its own stream.

    Parameters
    ----------
    seed, index
        Of the benchmark, and number of the patient.
    noise
        Factor on the standard deviation of every error of data and assumptions; 0: the data are the truth.
    """

    def stream(purpose: str) -> np.random.Generator:
        return generator(seed, PURPOSE, purpose, index)

    errors = Errors.scaled(noise)
    dominance = "left" if stream("dominance").uniform() < LEFT_DOMINANT else "right"
    lesions = _lesions(stream("stenoses"), dominance)
    anatomy_seed = int(stream("anatomy").integers(2**31))
    segmented = patient_anatomy(anatomy_seed, dominance, lesions)
    state, wrong = stream("state"), stream("assumed")
    values = {name: float(state.uniform(*bounds)) for name, bounds in UNIFORM.items()}
    arteries: tuple[Branch, ...] = ("LAD", "LCx", "RCA")
    conductance = {artery: float(state.uniform(*MICROVASCULAR)) for artery in arteries}
    off = {name: float(wrong.standard_normal()) for name in ("hyperaemia", "viscosity", "murray_exponent")}
    usual = Settings()
    settings = Settings(
        name=f"patient-{index}", anatomy_seed=anatomy_seed, cells=CELLS, microvascular=conductance,
        hyperaemia=usual.hyperaemia * float(np.exp(errors.routine.hyperaemia * off["hyperaemia"])), **values,
    )  # fmt: skip
    physics = Physics(
        viscosity=BLOOD_VISCOSITY * float(np.exp(errors.routine.viscosity * off["viscosity"])),
        murray_exponent=MURRAY_EXPONENT + errors.routine.murray_exponent * off["murray_exponent"],
        heart=_heart(stream("heart")),
    )
    true = _true_lumen(segmented, errors.lumen, stream("lumen"))
    return Drawn(index, seed, dominance, lesions, segmented, true, settings, physics, errors)


def _lesions(random: np.random.Generator, dominance: str) -> tuple[Lesion, ...]:
    number = int(random.choice(len(NUMBERS), p=NUMBERS))
    places = LEFT_PLACES if dominance == "left" else PLACES
    chosen = random.permutation(list(places))[:number].tolist()
    found = []
    for artery in sorted(chosen):
        course = PATTERNS[dominance].right if artery == "RCA" else artery
        at, length, reduction = (float(random.uniform(*bounds)) for bounds in (places[artery], LENGTH, REDUCTION))
        found.append(Lesion(artery, course, at, length, reduction))
    return tuple(found)


def _heart(random: np.random.Generator) -> Mapping[str, float]:
    factors = np.exp(HEART_SPREAD * random.standard_normal(len(HEART)))
    return {
        name: value * float(factor) if value > 0 else value
        for (name, value), factor in zip(HEART.items(), factors, strict=True)
    }


def _true_lumen(anatomy: Anatomy, error: LumenError, random: np.random.Generator) -> Anatomy:
    law = lumen_law(anatomy.tree, anatomy.stenoses, error, modes=MODES)
    z = {name: float(random.standard_normal()) for name in law.names}
    return replace(anatomy, tree=law.tree(anatomy.tree, z))
