"""Nuisance parameters of the recalibration: factors on groups of network parameters with log-normal priors."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core import units
from coronaryuq.discrepancy.data.conditions import BED_SHAPE, RESISTANCE, Condition
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import COMPLIANCES, CORONARY_TYPES, RESISTANCES, Anatomy
from coronaryuq.zerod.effects.beds import arteriolar
from coronaryuq.zerod.network.differences import LOSS

SD_MASS = 1.0
BLOOD = "blood volume"
"""Target of a factor on the stressed blood volume of a closed loop, which is part of no element."""
KNOWN = 1.0
"""Ratio of a perfusion to its standard deviation above which it may determine a tissue mass."""


@dataclass(frozen=True)
class Nuisance:
    """A factor exp(sd z), z standard normal, on `targets` in some conditions, or in all (None).

    targets: "BLOCK.parameter", or `BLOOD`. mass: territory whose tissue mass the factor scales instead, as perfusion is
    flow over mass. shape: row of `Forward.shapes` that is added to predictions, times z, instead. noise: whether that
    row is noise of the measurements. elements: what that row stands for in the network, ("BLOCK.parameter", change of
    its log by z = 1). several: whether data may have several optima in it, where its effect is not linear.
    """

    name: str
    sd: float
    targets: tuple[str, ...] = ()
    conditions: tuple[str, ...] | None = None
    mass: str | None = None
    shape: int | None = None
    noise: bool = False
    elements: tuple[tuple[str, float], ...] = ()
    several: bool = False

    @property
    def simulated(self) -> bool:
        """Whether it changes the runs and not only the readings."""
        return self.mass is None and self.shape is None

    def factor(self, z: np.ndarray) -> np.ndarray:
        return np.exp(self.sd * np.asarray(z))


def element_factors(parameters: list[Nuisance], z: np.ndarray) -> dict[str, float]:
    """Return the factors on elements of the network for which shapes stand, at z (p,), which starts with these."""
    logs: dict[str, float] = {}
    for nuisance, weight in zip(parameters, z, strict=False):
        for target, change in nuisance.elements:
            logs[target] = logs.get(target, 0.0) + float(change * weight)
    return {target: float(np.exp(value)) for target, value in logs.items()}


def without_noise(parameters: list[Nuisance], z: np.ndarray) -> np.ndarray:
    """Return z (p,), which starts with these parameters, with the noise of the measurements set to zero."""
    model_part = np.array(z, dtype=float)
    model_part[[column for column, nuisance in enumerate(parameters) if nuisance.noise]] = 0.0
    return model_part


def nuisances(
    network: Network, conditions: dict[str, Condition], measured: list[Measured], settings: Settings
) -> list[Nuisance]:
    """Return the nuisance parameters of a network and its measurements.

    Resistance and compliance of all coronary beds together and of each, and of the systemic beds; left ventricular
    elastance and blood volume in closed loops; a factor for every measured condition except the first, as
    its coronary state is never known exactly, and for every block that a condition scales; the tissue mass of each
    territory with measured perfusion; the shape of the beds if a condition lists it as free; and each stenosis that
    conditions list.
    """
    anatomy = Anatomy(network)
    beds = list(anatomy.dilating)
    which = "coronary" if any(anatomy.kind(bed) in CORONARY_TYPES for bed in beds) else "bed"
    found = _of_beds(anatomy, beds, which, settings.sd_coronary, settings.sd_compliance, settings)
    if any(BED_SHAPE in condition.free for condition in conditions.values()):
        found += _shape(anatomy, settings.sd_bed_shape)
    others = [bed for bed in anatomy.blocks if bed not in beds and bed in set(anatomy.outlet_bc.values())]
    found += _of_beds(anatomy, others, "systemic", settings.sd_systemic, settings.sd_systemic, settings)
    if anatomy.closed_loop:
        found.append(Nuisance("left ventricular elastance", settings.sd_heart, ("CLH.Elv_s",)))
        found.append(Nuisance(BLOOD, settings.sd_blood, (BLOOD,)))
    dilating = tuple(f"{bed}.{name}" for bed in beds for name in arteriolar(network, bed))
    used = [name for name in conditions if any(series.condition == name for series in measured)]
    for name in used:
        wide = RESISTANCE in conditions[name].free
        if name != used[0] or wide:
            sd = settings.sd_free if wide else settings.sd_condition
            found.append(Nuisance(f"{which} state of {name}", sd, dilating, (name,)))
        for block, factors in conditions[name].scale.items():
            scaled = tuple(f"{block}.{parameter}" for parameter in factors)
            found.append(Nuisance(f"scale of {block} under {name}", settings.sd_condition, scaled, (name,)))
    found += _stenoses({name: conditions[name] for name in used}, settings.sd_stenosis)
    territories = dict.fromkeys(series.location for series in measured if series.quantity == "perfusion")
    found += [Nuisance(f"mass of {place}", SD_MASS, mass=place) for place in territories]
    return found


def _of_beds(
    anatomy: Anatomy, beds: list[str], which: str, sd_resistance: float, sd_compliance: float, settings: Settings
) -> list[Nuisance]:
    """Return factors on the resistance of some beds together and, if they are several, of each; and on compliance."""
    found: list[Nuisance] = []
    for quantity, names, sd, sd_each in (
        ("resistance", RESISTANCES, sd_resistance, settings.sd_bed),
        ("compliance", COMPLIANCES, sd_compliance, settings.sd_bed_compliance),
    ):
        each = {bed: keys for bed in beds if (keys := present(anatomy, bed, names))}
        if each:
            found.append(Nuisance(f"{which} {quantity}", sd, tuple(key for keys in each.values() for key in keys)))
        if len(each) > 1:
            found += [Nuisance(f"{quantity} of {bed}", sd_each, keys) for bed, keys in each.items()]
    return found


def _shape(anatomy: Anatomy, sd: float) -> list[Nuisance]:
    """Return parameters for how resistance and compliance vary along the beds, and for vessel compliance."""
    beds, vessels = anatomy.dilating, anatomy.coronary_vessels
    groups = {
        "proximal resistance of the beds": [key for bed in beds for key in present(anatomy, bed, ("Ra1",))],
        "proximal compliance of the beds": [key for bed in beds for key in present(anatomy, bed, ("Ca",))],
        "compliance of the vessels": [key for vessel in vessels for key in present(anatomy, vessel, ("C",))],
    }
    return [Nuisance(name, sd, tuple(targets)) for name, targets in groups.items() if targets]


def present(anatomy: Anatomy, block: str, names: Iterable[str]) -> tuple[str, ...]:
    """Return those of some parameters, "BLOCK.parameter", that a vessel or a boundary condition has."""
    vessel = anatomy.vessels.get(block)
    values = anatomy.blocks[block]["bc_values"] if vessel is None else vessel["zero_d_element_values"]
    return tuple(f"{block}.{name}" for name in names if values.get(name, 0.0) > 0.0)


def _stenoses(conditions: dict[str, Condition], sd: float) -> list[Nuisance]:
    """Return a factor on the loss of each stenosis of unknown severity, under its conditions."""
    named: dict[tuple[str, str], list[str]] = {}
    for condition in conditions.values():
        for vessel, name in condition.stenosis.items():
            named.setdefault((vessel, name), []).append(condition.name)
    return [
        Nuisance(f"stenosis {name} of {vessel}", sd, (f"{vessel}.{LOSS}",), tuple(under))
        for (vessel, name), under in named.items()
    ]


def tissue_mass(territory: str, conditions: dict[str, Condition], measured: list[Measured], anatomy: Anatomy) -> float:
    """Return the tissue mass (g) with which the plain model reproduces the first measured perfusion.

    A fitted condition is used if there is one, because the prior mean must not depend on held-out data. Readings below
    their own noise are skipped, unless all are below.
    """
    own = [s for s in measured if s.quantity == "perfusion" and s.location == territory]
    own = [s for s in own if not conditions[s.condition].held_out] or own
    clear = {s.condition: float(s.value[0] / s.sd[0]) for s in own}
    first = next((s for s in own if clear[s.condition] > KNOWN), max(own, key=lambda s: clear[s.condition]))
    scale = conditions[first.condition].coronary_resistance_scale if territory in anatomy.dilating else 1.0
    flow = anatomy.flow_scale(anatomy.beds[territory]) / scale
    return flow / max(float(first.value[0]), float(first.sd[0]), 1e-3 * units.MBF_PER_MIN_PER_G)
