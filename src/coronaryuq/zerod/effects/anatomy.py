"""The beds of a network that effects act on, and the flow and pressure scales that make their sizes dimensionless."""

from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology

CORONARY_TYPES = ("CORONARY", "CORONARY_VAR_RES", "ClosedLoopCoronaryLeft", "ClosedLoopCoronaryRight")
SYSTEMIC_TYPES = ("RCR", "ClosedLoopRCR", "RESISTANCE")
RESISTANCES = ("Ra", "Ram", "Rv", "Ra1", "Ra2", "Ra2_min", "Ra2_max", "Rv1", "Rp", "Rd", "R")
"""All names of bed resistances in svZeroDSolver."""
COMPLIANCES = ("Ca", "Cim", "Cc", "C")
"""All names of bed compliances in svZeroDSolver."""
ARTERIOLAR = ("Ra", "Ram", "Ra1", "Ra2", "Ra2_min", "Ra2_max")
"""Resistances that hyperaemia lowers."""


class Anatomy(Topology):
    """Topology of a network, its beds under study, and the scales of a run of the unmodified model.

    Attributes
    ----------
    pressure : float
        Mean pressure at the root, in the network's unit; effects scale their priors by it and by `flow`.
    flow : dict of str to float
        Absolute mean flow of each vessel, in the network's unit.
    period : float
        Cardiac period (s).
    driven : set of str
        Boundary conditions of which a waveform is given under some condition.
    dilated : bool
        Whether a condition to be fitted may dilate the beds.
    """

    def __init__(
        self, network: Network, pressure: float = 1.0, flow: dict[str, float] | None = None, period: float = 1.0
    ):
        super().__init__(network)
        self.pressure, self.flow, self.period = pressure, flow or {}, period
        self.driven, self.dilated = set[str](), True

    @property
    def dilating(self) -> dict[str, str]:
        """Boundary condition → vessel of the beds that hyperaemia dilates: the coronary ones or, if none, all."""
        return self._of_types(CORONARY_TYPES) or self._of_types(SYSTEMIC_TYPES)

    @property
    def beds(self) -> dict[str, str]:
        """Boundary condition → vessel of the beds under study: all outlets or, of a closed loop, those that dilate."""
        return self.dilating if self.closed_loop else self._of_types(CORONARY_TYPES + SYSTEMIC_TYPES)

    def _of_types(self, types: tuple[str, ...]) -> dict[str, str]:
        return {bed: vessel for bed, vessel in self.vessel_of.items() if self.kind(bed) in types}

    @property
    def coronary_vessels(self) -> list[str]:
        """Vessels that lead only to beds under study, in the network's order."""
        return self._leading_to(self.beds)

    @property
    def ostia(self) -> list[str]:
        """First vessels of the trees whose beds hyperaemia dilates."""
        inside = self._leading_to(self.dilating)
        return [name for name in inside if not set(inside).intersection(self.parents(name))]

    def beds_below(self, vessel: str) -> list[str]:
        """Return the beds under study downstream of a vessel."""
        beds = self.beds
        return [bed for bed in self.outlets_below(vessel) if bed in beds]

    def _leading_to(self, beds: dict[str, str]) -> list[str]:
        below = {name: self.outlets_below(name) for name in self.vessels}
        return [name for name, outlets in below.items() if outlets and all(bed in beds for bed in outlets)]

    def vessel_at(self, location: str) -> str | None:
        """Return the vessel to which a location "A:B" belongs."""
        return next((part for part in location.split(":") if part in self.vessels), None)

    def flow_scale(self, vessel: str) -> float:
        """Return the mean flow of a vessel, at least a millionth of the largest; the largest if it is unknown."""
        largest = max((abs(q) for q in self.flow.values()), default=1.0) or 1.0
        return max(abs(self.flow.get(vessel, largest)), 1e-6 * largest)
