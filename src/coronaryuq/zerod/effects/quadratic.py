"""What all kinetic losses share: a drop of pressure with the square of flow in one or several vessels."""

from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Effect, Parameter, vessel_values
from coronaryuq.zerod.effects.grafting import put_ahead

TAG = "loss"


class QuadraticLoss(Effect):
    """A loss S |Q| Q at the start of every vessel that a place stands for.

    It enters as the vessel's own `stenosis_coefficient`, but not where the vessel stores blood: the element's equations
    hold C 2 S |Q| dQ/dt then, which is not monotone in one time step, so that a strong loss may leave a step without a
    solution. There it goes into a vessel put ahead, which is the same network.
    """

    native = "stenosis_coefficient of the vessel; of one put ahead of it, where the vessel has a C"
    grafted = True
    parameters = (
        Parameter("loss", "1", "lognormal", 0.1, 1.2, "share of the mean pressure lost at the model's own mean flow"),
    )

    def vessels(self, place: str, anatomy: Anatomy) -> list[str]:
        """The vessels that lose pressure."""
        return [place]

    def inserts(self, place, anatomy):
        return any(_stores(anatomy.network, vessel) for vessel in self.vessels(place, anatomy))

    def insert(self, network, place, anatomy):
        network = super().insert(network, place, anatomy)
        for vessel in self._unprepared(network, place, anatomy):
            network = put_ahead(network, vessel, TAG)
        return network

    def aliases(self, place, anatomy):
        waiting = self._unprepared(anatomy.network, place, anatomy)
        return {anatomy.inlet(v): f"{anatomy.upstream[v]}:{v}_{TAG}" for v in waiting}

    def changes(self, network, place, sizes, anatomy, condition):
        found = {}
        for vessel in self.vessels(place, anatomy):
            ahead = f"{vessel}_{TAG}"
            name = ahead if _has(network, ahead) else vessel
            present = vessel_values(network, name).get("stenosis_coefficient", 0.0)
            found[f"{name}.stenosis_coefficient"] = present + self._coefficient(vessel, sizes["loss"], anatomy)
        return found

    def physical(self, place, sizes, anatomy):
        vessels = self.vessels(place, anatomy)
        words = "stenosis_coefficient added"
        return {
            words if len(vessels) == 1 else f"{words} to {v}": self._coefficient(v, sizes["loss"], anatomy)
            for v in vessels
        }

    def _unprepared(self, network, place, anatomy) -> list[str]:
        """Vessels that still need one ahead; another effect may have put it there."""
        return [
            vessel
            for vessel in self.vessels(place, anatomy)
            if _stores(network, vessel) and not _has(network, f"{vessel}_{TAG}")
        ]

    @staticmethod
    def _coefficient(vessel, loss, anatomy):
        return loss * anatomy.pressure / anatomy.flow_scale(vessel) ** 2


def _has(network: dict, vessel: str) -> bool:
    return any(entry["vessel_name"] == vessel for entry in network["vessels"])


def _stores(network: dict, vessel: str) -> bool:
    return vessel_values(network, vessel).get("C", 0.0) > 0.0
