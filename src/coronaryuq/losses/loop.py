"""The 0D loop at the inputs of 3D runs, as a function of standardised losses."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from coronaryuq.case.network.network import Network
from coronaryuq.case.network.schematic import radius_from_inertance
from coronaryuq.case.network.topology import Topology
from coronaryuq.core.records import Record
from coronaryuq.core.units import MMHG
from coronaryuq.losses.fit import LossFit
from coronaryuq.losses.places import QUADRATIC, RESISTANCE, Edge, Place
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.result import Result
from coronaryuq.zerod.theta import theta_changes

LARGEST = 0.05
"""Prior standard deviation of the pressure that a quadratic loss takes at the mean flow, over the aortic pressure."""
CERTAIN = 1.96
"""Posterior standard deviations by which a loss must differ from zero to be named."""
MEANINGS = {
    (RESISTANCE, True): "more friction than a straight tube's",
    (RESISTANCE, False): "less friction than a straight tube's",
    (QUADRATIC, True): "separation, turbulence or a narrowing vessel",
    (QUADRATIC, False): "less separation, or recovery of kinetic energy",
}
"""What a loss of each kind and sign stands for."""


class LossLoop:
    """A loop whose vessels in the 3D domain get losses; standardised ones have a standard normal prior.

    The first of them are linear, one per piece of the domain, relative to the piece's own resistance; the others are
    quadratic, relative to `LARGEST` of the aortic pressure at the piece's mean flow.

    Parameters
    ----------
    network
        The loop that the 3D runs were coupled to.
    compared, pieces
        Places and pieces of the domain.
    aorta
        0D connection of the aortic pressure.
    density
        Of blood, g/cm3.
    runs
        Records of the 3D runs.

    Attributes
    ----------
    own
        Vessel → its own resistance and quadratic coefficient.
    lowest
        (p,) lower bounds: no piece has a negative resistance, and a quadratic loss gives back no more than the kinetic
        energy of a developed profile with which blood enters the piece.
    """

    def __init__(
        self, network: Network, compared: Sequence[Place], pieces: Sequence[Edge], aorta: str, density: float,
        runs: Sequence[Record],
    ):  # fmt: skip
        self.compared, self.pieces, self.count = compared, pieces, len(runs)
        self.engine, self.aorta = Engine(network), f"mean_pressure:{aorta}"
        self.own = {
            name: {key: float(network.vessel_values(name).get(key, 0.0)) for key in (RESISTANCE, QUADRATIC)}
            for piece in pieces
            for name in piece.vessels
        }
        inputs = {name: np.array([run.inputs[name] for run in runs]) for name in runs[0].inputs}
        changes = theta_changes(network, inputs)
        self.theta = {name: np.broadcast_to(value, (self.count,)) for name, value in changes.items()}
        topology = Topology(network)
        self.flow = [f"mean_flow:{topology.inlet(piece.vessels[0])}" for piece in pieces]
        at = dict.fromkeys(place.location for place in compared)
        means = [f"mean_{kind}:{location}" for location in at for kind in ("pressure", "flow")]
        self.quantities = list(dict.fromkeys([self.aorta, *self.flow, *means]))
        self.start = self.engine.run_to_periodic({}, self.quantities).state[0]
        plain = self._run({}, 1)
        self.mean_flow = np.array([abs(float(np.mean(plain.values[name]))) for name in self.flow])
        self.quadratic = LARGEST * float(np.mean(plain.values[self.aorta])) / self.mean_flow**2
        recovered = np.array([_kinetic(topology, piece.vessels[0], density) for piece in pieces])
        own = np.array([self._inside(piece, QUADRATIC) for piece in pieces])
        self.lowest = np.concatenate([-np.ones(len(pieces)), -(own + recovered) / self.quadratic])

    def pressures(self, losses: np.ndarray) -> np.ndarray:
        """Return mean pressures over the aortic one, (k, n, m), with standardised losses (k, p), of n runs."""
        result = self._run(self._changes(losses), len(losses))
        columns = []
        for place in self.compared:
            pressure, flow = (result.values[f"mean_{kind}:{place.location}"] for kind in ("pressure", "flow"))
            columns.append((pressure + place.resistance * flow) / result.values[self.aorta])
        return np.stack(columns, axis=-1).reshape(len(losses), self.count, -1)

    def elements(self, losses: np.ndarray) -> dict[str, dict[str, float]]:
        """Return vessel → resistance and quadratic coefficient with standardised losses (p,)."""
        found = {name: dict(values) for name, values in self.own.items()}
        for target, value in self._changes(losses[None]).items():
            name, _, key = target.rpartition(".")
            found[name][key] = float(value[0])
        return found

    def table(self, fit: LossFit) -> pd.DataFrame:
        """Return a row per loss: where it is, its size with a standard deviation, and what it stands for."""
        sd, rows = np.sqrt(np.diag(fit.covariance)), []
        for number, piece in enumerate(self.pieces):
            own = {RESISTANCE: self._inside(piece, RESISTANCE), QUADRATIC: self._inside(piece, QUADRATIC)}
            scales = {RESISTANCE: own[RESISTANCE], QUADRATIC: self.quadratic[number]}
            for place, key in ((number, RESISTANCE), (number + len(self.pieces), QUADRATIC)):
                added, error = scales[key] * fit.mean[place], scales[key] * sd[place]
                per_size = self.mean_flow[number] ** (1 if key == RESISTANCE else 2) / MMHG
                rows.append(
                    {
                        "vessels": " ".join(piece.vessels),
                        "loss": "linear" if key == RESISTANCE else "quadratic",
                        "unit": "dyn s/cm5" if key == RESISTANCE else "dyn s2/cm8",
                        "own": own[key],
                        "added": added,
                        "added_sd": error,
                        "own_mmhg": own[key] * per_size,
                        "added_mmhg": added * per_size,
                        "added_sd_mmhg": error * per_size,
                        "meaning": MEANINGS[key, added > 0] if abs(added) > CERTAIN * error else "",
                    }
                )
        return pd.DataFrame(rows)

    def _inside(self, piece: Edge, element: str) -> float:
        """Return the sum of an element over what lies of a piece's vessels inside the 3D domain."""
        outside = piece.outside if element == RESISTANCE else piece.outside_quadratic
        return sum((1.0 - share) * self.own[name][element] for name, share in zip(piece.vessels, outside, strict=True))

    def _changes(self, losses: np.ndarray) -> dict[str, np.ndarray]:
        """Return "VESSEL.element" → values (k,) of the losses (k, p)."""
        changes = {}
        for number, piece in enumerate(self.pieces):
            for name, outside in zip(piece.vessels, piece.outside, strict=True):
                factor = outside + (1.0 - outside) * (1.0 + losses[:, number])
                changes[f"{name}.{RESISTANCE}"] = self.own[name][RESISTANCE] * factor
            added = self.quadratic[number] * losses[:, number + len(self.pieces)]
            changes[f"{piece.carrier}.{QUADRATIC}"] = self.own[piece.carrier][QUADRATIC] + added
        return changes

    def _run(self, changes: dict[str, np.ndarray], sets: int) -> Result:
        """Run all inputs with each of some sets of elements, the inputs of the first set first."""
        theta = {name: np.tile(value, sets) for name, value in self.theta.items()}
        own = {name: np.repeat(value, self.count) for name, value in changes.items()}
        result = self.engine.run_to_periodic(theta | own, self.quantities, start=self.start)
        if not result.ok.all():
            reason = result.status[~result.ok][0]
            raise RuntimeError(
                f"the loop does not run with the losses of the 3D runs ({reason}); set losses.runs_3d: 0"
            )
        return result


def _kinetic(topology: Topology, vessel: str, density: float) -> float:
    """Return ρ/A² of a vessel by the area that its inertance implies: kinetic energy over squared flow, dyn s2/cm8.

    Infinite, no bound, where no area is known.
    """
    radius = radius_from_inertance(topology, vessel, density)
    return np.inf if radius is None else density / (np.pi * radius**2) ** 2
