"""Base class of kinetic losses: a pressure drop with the square of flow in one or several vessels."""

from typing import ClassVar

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Number, Parameter, Values
from coronaryuq.zerod.effects.grafting import grafted, grafted_name, put_ahead

TAG = "loss"


class QuadraticLoss(Effect):
    """Pressure loss S |Q| Q at the start of every vessel of a place.

    It enters as the vessel's `stenosis_coefficient`, unless the vessel stores blood: the element's equations then
    contain C 2 S |Q| dQ/dt, which is not monotone within a time step, so that a strong loss may leave a step without a
    solution. In that case it goes into a vessel ahead, which is an equivalent network.
    """

    native = "stenosis_coefficient of the vessel, or of a vessel added upstream if the vessel has a C"
    grafted = True
    tag: ClassVar[str] = TAG
    """Suffix of the added vessels."""
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("loss", "1", "lognormal", 0.1, 1.2, "fraction of the mean pressure lost at the model's mean flow"),
    )

    def vessels(self, place: str, anatomy: Anatomy) -> list[str]:
        """Return the vessels that lose pressure."""
        return [place]

    def inserts(self, place: str, anatomy: Anatomy) -> bool:
        return any(self._added(anatomy.network, vessel) for vessel in self.vessels(place, anatomy))

    def insert(self, network: Network, place: str, anatomy: Anatomy) -> Network:
        network = super().insert(network, place, anatomy)
        for vessel in self._without_stub(network, place, anatomy):
            network = put_ahead(network, vessel, self.tag)
        return network

    def aliases(self, place: str, anatomy: Anatomy) -> dict[str, str]:
        vessels = self._without_stub(anatomy.network, place, anatomy)
        stubs = {v: grafted_name(anatomy.network, f"{v}_{self.tag}") for v in vessels}
        return {anatomy.inlet(v): f"{anatomy.upstream[v]}:{stubs[v]}" for v in vessels}

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        changes: Values = {}
        for vessel in self.vessels(place, anatomy):
            name = grafted(network, f"{vessel}_{self.tag}") or vessel
            present = network.vessel_values(name).get("stenosis_coefficient", 0.0)
            changes[f"{name}.stenosis_coefficient"] = present + self._coefficient(vessel, sizes["loss"], anatomy)
        return changes

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        vessels = self.vessels(place, anatomy)
        label = "stenosis_coefficient added"
        return {
            label if len(vessels) == 1 else f"{label} to {v}": self._coefficient(v, sizes["loss"], anatomy)
            for v in vessels
        }

    def _without_stub(self, network: Network, place: str, anatomy: Anatomy) -> list[str]:
        """Return the vessels that still need a vessel upstream; another effect may have added it."""
        return [
            vessel
            for vessel in self.vessels(place, anatomy)
            if self._added(network, vessel) and not grafted(network, f"{vessel}_{self.tag}")
        ]

    def _added(self, network: Network, vessel: str) -> bool:
        """Whether the loss of a vessel is that of an added one."""
        return network.vessel_values(vessel).get("C", 0.0) > 0.0

    @staticmethod
    def _coefficient(vessel: str, loss: Number, anatomy: Anatomy) -> Number:
        return loss * anatomy.pressure / anatomy.flow_scale(vessel) ** 2
