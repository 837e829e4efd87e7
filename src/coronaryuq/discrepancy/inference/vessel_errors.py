"""Errors of the vessels and of the parts of beds, as shapes of the predictions.

A lumen is segmented with an error, and a wall's stiffness is not measured; the aorta's vessels are no exception. How a
bed's resistance and compliance are shared between its parts, such as Rp and Rd, is a convention, not a measurement.
So is the number of parts into which a network divides a vessel: each part stores its blood in one place. A network's
pressures are total ones, but probes read static pressure. Where these errors change predictions little, their effect is
linear, and its few leading shapes get weights, like those of the time steps. Where it is not, as that of an aorta's
inertance on its resonance, the errors are parameters of the model; where the phase of an oscillation is unknown, see
`known_errors`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from coronaryuq.core import units
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect
from coronaryuq.discrepancy.forward.nuisance import Nuisance, present
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.zerod.effects.anatomy import COMPLIANCES, RESISTANCES, Anatomy
from coronaryuq.zerod.effects.dynamic_pressure import DynamicPressure
from coronaryuq.zerod.effects.subdivision import Subdivision

SD_RESISTANCE, SD_COMPLIANCE = 0.08, 0.12
"""Standard deviations of the logs: 0.08 is that of a radius by 2 %, in the resistance of Poiseuille's law."""
SD_BED = 0.2
"""Of the log of each part of a bed; the bed's resistance and compliance in all have priors of their own."""
SHAPED = 0.3
"""Length, in noise standard deviations, above which an error is a separate shape, or not linear."""
ELEMENTS = (
    ("resistance", "R_poiseuille", SD_RESISTANCE),
    ("inertance", "L", SD_RESISTANCE),
    ("compliance", "C", SD_COMPLIANCE),
)


@dataclass(frozen=True, eq=False)
class VesselErrors:
    """Errors of the vessels, and their effect.

    Attributes
    ----------
    errors
        With standard normal sizes.
    changes
        Of the predictions by one standard deviation of each: (errors, N), CGS.
    curved
        What of these changes is not linear: (errors, N), CGS.
    """

    errors: Sequence[Nuisance]
    changes: np.ndarray
    curved: np.ndarray

    def divided(self, noise: np.ndarray) -> tuple["VesselErrors", "VesselErrors"]:
        """Return the errors whose effect is linear within a noise (N,), CGS, and the others."""
        linear = np.linalg.norm(self.curved / noise, axis=1) <= SHAPED
        return self._of(linear), self._of(~linear)

    def with_(self, other: "VesselErrors") -> "VesselErrors":
        """Return these errors and others."""
        pairs = ((self.changes, other.changes), (self.curved, other.curved))
        return VesselErrors([*self.errors, *other.errors], *(np.vstack(pair) for pair in pairs))

    def _of(self, some: np.ndarray) -> "VesselErrors":
        return VesselErrors(list(compress(self.errors, some)), self.changes[some], self.curved[some])

    def shapes(self, noise: np.ndarray) -> tuple[list[Nuisance], np.ndarray, np.ndarray]:
        """Return the shapes of the linear effect, and what they leave.

        Parameters
        ----------
        noise
            Standard deviations of the data: (N,), CGS.

        Returns
        -------
        weights, shapes, sd
            Nuisance parameters whose rows of `Forward.shapes` are yet to be numbered, these rows (k, N), and the
            standard deviations of the rest (N,), CGS.
        """
        if not self.errors:
            return [], np.zeros((0, len(noise))), np.zeros(len(noise))
        shares, lengths, directions = np.linalg.svd(self.changes / noise, full_matrices=False)
        scaled, kept = lengths[:, None] * directions * noise, lengths > SHAPED
        weights = [
            Nuisance(
                f"vessels, shape {number + 1}",
                1.0,
                shape=number,
                elements=tuple(
                    (target, error.sd * float(share))
                    for error, share in zip(self.errors, shares[:, number], strict=True)
                    for target in error.targets
                ),
            )
            for number in np.flatnonzero(kept).tolist()
        ]
        return weights, scaled[kept], np.sqrt((scaled[~kept] ** 2).sum(axis=0))


def vessel_errors(forward: Forward) -> VesselErrors:
    """Run the model with each error of its vessels; those with which it does not run are left out."""
    errors = [
        Nuisance(f"{name} of {vessel}", sd, targets, several=True)
        for vessel in forward.anatomy.vessels
        for name, element, sd in ELEMENTS
        if (targets := present(forward.anatomy, vessel, (element,)))
    ]
    errors += _of_beds(forward.anatomy)
    own = replace(forward, shapes=None).with_nuisances([*forward.nuisances, *errors])
    # First alone: in a closed loop the others start from its state.
    (plain,) = own.predict(np.zeros(len(own.nuisances)))
    each = np.eye(len(own.nuisances))[len(forward.nuisances) :]
    more, less = (own.predict(sign * each) - plain for sign in (1.0, -1.0))
    return VesselErrors(errors, (more - less) / 2.0, (more + less) / 2.0)._of(np.isfinite(more + less).all(axis=1))


def lumping_errors(forward: Forward) -> VesselErrors:
    """Run the model with each of its vessels as a chain of parts, and with the kinetic energy at its probes.

    The data tell the weights, 1 for real vessels. A pullback reads means, which do not depend on the parts.
    """
    density, plain = units.BLOOD_DENSITY / forward.pressure_factor, np.zeros(len(forward.nuisances))
    effects = (Subdivision(), DynamicPressure(density))
    missing = [PlacedEffect(effect, place) for effect in effects for place in effect.places(forward.anatomy)]
    points = [(np.append(plain, 1.0), Hypothesis((one,))) for one in missing]
    lumped, *real = replace(forward, shapes=None).predict_rows([(plain, PLAIN), *points], grafts=missing)
    changes = np.array(real).reshape(-1, forward.size) - lumped
    for rows, series in zip(forward.rows, forward.measured, strict=True):
        changes[:, rows] *= series.pullback is None
    errors = [Nuisance(f"{one.effect.name} at {one.place}", 1.0) for one in missing]
    return VesselErrors(errors, changes, np.zeros_like(changes))._of(np.isfinite(changes).all(axis=1))


def _of_beds(anatomy: Anatomy) -> list[Nuisance]:
    """Return the errors of the parts of each bed but the largest: in all, beds are parameters of the model."""
    errors = []
    for bed in dict.fromkeys(anatomy.outlet_bc.values()):
        values = anatomy.blocks[bed]["bc_values"]
        for names in (RESISTANCES, COMPLIANCES):
            parts = sorted((name for name in names if values.get(name, 0.0) > 0.0), key=lambda name: values[name])
            errors += [Nuisance(f"{name} of {bed}", SD_BED, (f"{bed}.{name}",)) for name in parts[:-1]]
    return errors
