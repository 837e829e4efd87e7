"""Side branch missing from the model."""

from collections.abc import Sequence

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Number, Parameter, Series, Values
from coronaryuq.zerod.effects.grafting import add_vessel, attach, locations_renamed, open_end


class SideBranchLeak(Effect):
    """Flow lost to a side branch at the end of a vessel, through a resistance to the veins."""

    name = "side_branch_leak"
    formula = "Q_leak = (P - P_v) / R_leak at the vessel's end; P_v = 0 in an open loop"
    source = "Gosling et al., J. Biomech. 103 (2020) 109698 (side-branch flow)"
    signature = "flow into the vessel above the sum of the flows out of it; distal pressures slightly lower"
    native = "a BloodVessel with a RESISTANCE (open loop) or ClosedLoopRCR (closed loop) outlet"
    grafted = True
    parameters = (Parameter("share", "1", "lognormal", 0.2, 1.0, "leak over the mean flow of the vessel in the model"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return anatomy.coronary_vessels

    def insert(self, network: Network, place: str, anatomy: Anatomy) -> Network:
        network, junction, _ = open_end(network, place, "leak")
        weak = 1e9 * anatomy.pressure / anatomy.flow_scale(place)
        bed = f"BC_leak_{place}"
        if anatomy.closed_loop:
            values = {"Rp": 0.1 * weak, "Rd": 0.9 * weak, "C": 0.0, "closed_loop_outlet": True}
            block = {"bc_name": bed, "bc_type": "ClosedLoopRCR", "bc_values": values}
        else:
            block = {"bc_name": bed, "bc_type": "RESISTANCE", "bc_values": {"R": weak, "Pd": 0.0}}
        network["boundary_conditions"].append(block)
        attach(network, junction, "outlet", add_vessel(network, f"leak_{place}", {"R_poiseuille": 0.0}, outlet=bed))
        return network

    def aliases(self, place: str, anatomy: Anatomy) -> dict[str, str]:
        return locations_renamed(anatomy, place, "leak")

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        resistance, bed = self._resistance(place, sizes["share"], anatomy), f"BC_leak_{place}"
        if anatomy.closed_loop:
            return {f"{bed}.Rp": 0.1 * resistance, f"{bed}.Rd": 0.9 * resistance}
        return {f"{bed}.R": resistance}

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return {"resistance of the leak": self._resistance(place, sizes["share"], anatomy)}

    @staticmethod
    def _resistance(place: str, share: Number, anatomy: Anatomy) -> Number:
        return anatomy.pressure / (share * anatomy.flow_scale(place))
