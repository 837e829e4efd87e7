"""Side branch missing from the model."""

from collections.abc import Sequence

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Number, Parameter, Series, Values
from coronaryuq.zerod.effects.grafting import (
    DISTAL,
    add_vessel,
    attach,
    grafted_name,
    locations_renamed,
    open_end,
    probes_kept,
)


class SideBranchLeak(Effect):
    """Flow lost to a side branch at the end of a vessel, through a resistance to the veins."""

    name = "side_branch_leak"
    formula = "Q_leak = (P - P_v) / R_leak at the vessel's end; P_v = 0 in an open loop"
    source = "Gosling et al., J. Biomech. 103 (2020) 109698 (side-branch flow)"
    signature = "flow into the vessel above the sum of the flows out of it; distal pressures slightly lower"
    native = "a BloodVessel with a RESISTANCE (open loop) or ClosedLoopRCR (closed loop) outlet"
    grafted = True
    parameters = (Parameter("share", "1", "lognormal", 0.2, 1.0, "leak over the mean flow of the vessel in the model"),)
    tag, added = "leak", "leak"
    """Suffix of the stub to the bed, and prefix of the added vessel."""

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return anatomy.coronary_vessels

    def insert(self, network: Network, place: str, anatomy: Anatomy) -> Network:
        network, junction, _ = open_end(network, place, self.tag)
        weak = 1e9 * anatomy.pressure / anatomy.flow_scale(place)
        bed = self._bed(network, place)
        leak = add_vessel(network, f"{self.added}_{place}", {"R_poiseuille": 0.0}, outlet=bed)
        if anatomy.closed_loop:
            values = {"Rp": 0.1 * weak, "Rd": 0.9 * weak, "C": 0.0, "closed_loop_outlet": True}
            block = {"bc_name": bed, "bc_type": "ClosedLoopRCR", "bc_values": values}
        else:
            block = {"bc_name": bed, "bc_type": "RESISTANCE", "bc_values": {"R": weak, "Pd": 0.0}}
        network["boundary_conditions"].append(block)
        attach(network, junction, "outlet", leak)
        return network

    def aliases(self, place: str, anatomy: Anatomy) -> dict[str, str]:
        return locations_renamed(anatomy, place, self.tag)

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        resistance, bed = self._resistance(place, sizes["share"], anatomy), self._bed(network, place)
        if anatomy.closed_loop:
            return {f"{bed}.Rp": 0.1 * resistance, f"{bed}.Rd": 0.9 * resistance}
        return {f"{bed}.R": resistance}

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return {"resistance of the leak": self._resistance(place, sizes["share"], anatomy)}

    def _bed(self, network: Network, place: str) -> str:
        return f"BC_{grafted_name(network, f'{self.added}_{place}')}"

    @staticmethod
    def _resistance(place: str, share: Number, anatomy: Anatomy) -> Number:
        return anatomy.pressure / (share * anatomy.flow_scale(place))


class DistalLeak(SideBranchLeak):
    """Flow lost to a side branch beyond the flow probe at the end of a vessel.

    The probe measures the leak as well, perfusion does not. It resembles a bed of lower resistance that neither dilates
    nor is compressed: incomplete hyperaemia, a gain of the probe.
    """

    name = "distal_leak"
    formula = "Q_leak = (P - P_v) / R_leak beyond the probe at the vessel's end; P_v = 0 in an open loop"
    signature = (
        "measured flow into a bed too high, by an amount in proportion to pressure that does not rise as it dilates"
    )
    beyond_probes = True
    tag, added = DISTAL, "distal_leak"

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        probes = {s.location for s in observed if s.quantity == "flow"}
        return [vessel for vessel in anatomy.beds.values() if anatomy.outlet(vessel) in probes]

    def aliases(self, place: str, anatomy: Anatomy) -> dict[str, str]:
        return probes_kept(anatomy, place)
