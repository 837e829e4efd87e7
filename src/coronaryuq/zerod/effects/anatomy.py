"""Topology of a 0D network, and the flow and pressure scales that make the sizes of effects dimensionless."""

from dataclasses import dataclass, field

CORONARY_TYPES = ("CORONARY", "CORONARY_VAR_RES", "ClosedLoopCoronaryLeft", "ClosedLoopCoronaryRight")
SYSTEMIC_TYPES = ("RCR", "ClosedLoopRCR", "RESISTANCE")
RESISTANCES = ("Ra", "Ram", "Rv", "Ra1", "Ra2", "Ra2_min", "Ra2_max", "Rv1", "Rp", "Rd", "R")
"""All names of bed resistances in svZeroDSolver."""
ARTERIOLAR = ("Ra", "Ram", "Ra1", "Ra2", "Ra2_min", "Ra2_max")
"""Resistances that hyperaemia lowers."""


@dataclass
class Anatomy:
    """Topology of a svZeroDSolver network with its reference pressure and flows.

    `pressure` (mean at the root), `flow` (mean per vessel, absolute) and `period` come from a reference run of the
    model, in the network's units; effects scale their priors by them.
    """

    network: dict
    pressure: float = 1.0
    flow: dict[str, float] = field(default_factory=dict)
    period: float = 1.0

    def __post_init__(self) -> None:
        names = {v["vessel_id"]: v["vessel_name"] for v in self.network["vessels"]}
        self.vessels = {v["vessel_name"]: v for v in self.network["vessels"]}
        self.blocks = {b["bc_name"]: b for b in self.network.get("boundary_conditions", [])}
        self.upstream: dict[str, str] = {}
        self.downstream: dict[str, str] = {}
        self.children: dict[str, list[str]] = {name: [] for name in self.vessels}
        self.parents: dict[str, list[str]] = {name: [] for name in self.vessels}
        for junction in self.network.get("junctions", []):
            above, below = (_members(junction, side, names) for side in ("inlet", "outlet"))
            for name in above:
                self.downstream[name] = junction["junction_name"]
                self.children[name] += below
            for name in below:
                self.upstream[name] = junction["junction_name"]
                self.parents[name] += above
        self.inlet_bc: dict[str, str] = {}
        self.outlet_bc: dict[str, str] = {}
        for name, vessel in self.vessels.items():
            ends = vessel.get("boundary_conditions", {})
            if "inlet" in ends:
                self.upstream[name] = self.inlet_bc[name] = ends["inlet"]
            if "outlet" in ends:
                self.downstream[name] = self.outlet_bc[name] = ends["outlet"]
        for heart in self.network.get("closed_loop_blocks", []):
            for name in heart.get("outlet_blocks", []):
                self.upstream.setdefault(name, "J_heart_outlet")

    @property
    def closed_loop(self) -> bool:
        return bool(self.network.get("closed_loop_blocks"))

    @property
    def roots(self) -> list[str]:
        """Vessels without a parent vessel."""
        return [name for name in self.vessels if not self.parents[name]]

    @property
    def beds(self) -> dict[str, str]:
        """Boundary condition → vessel of the beds under study: the coronary beds or, if there are none, all outlets."""
        outlets = {bc: vessel for vessel, bc in self.outlet_bc.items()}
        coronary = {bc: v for bc, v in outlets.items() if self.blocks[bc]["bc_type"] in CORONARY_TYPES}
        return coronary or {bc: v for bc, v in outlets.items() if self.blocks[bc]["bc_type"] in SYSTEMIC_TYPES}

    @property
    def coronary_vessels(self) -> list[str]:
        """Vessels that lead only to beds under study, in the network's order."""
        return [name for name in self.vessels if self.beds_below(name) and not self._others_below(name)]

    @property
    def ostia(self) -> list[str]:
        """First vessels of the coronary trees."""
        inside = set(self.coronary_vessels)
        return [name for name in self.coronary_vessels if not inside.intersection(self.parents[name])]

    def below(self, vessel: str) -> list[str]:
        """Return the vessel and all vessels downstream of it."""
        found: list[str] = []
        queue = [vessel]
        while queue:
            name = queue.pop(0)
            if name not in found:
                found.append(name)
                queue += self.children[name]
        return found

    def beds_below(self, vessel: str) -> list[str]:
        """Return the beds under study downstream of a vessel."""
        beds = self.beds
        return [self.outlet_bc[name] for name in self.below(vessel) if self.outlet_bc.get(name) in beds]

    def _others_below(self, vessel: str) -> list[str]:
        beds = self.beds
        return [self.outlet_bc[n] for n in self.below(vessel) if n in self.outlet_bc and self.outlet_bc[n] not in beds]

    def inlet(self, vessel: str) -> str:
        """Return the location of the vessel's start, "FEEDER:VESSEL"."""
        return f"{self.upstream[vessel]}:{vessel}"

    def outlet(self, vessel: str) -> str:
        """Return the location of the vessel's end, "VESSEL:FED"."""
        return f"{vessel}:{self.downstream[vessel]}"

    def vessel_at(self, location: str) -> str | None:
        """Return the vessel that a location "A:B" belongs to."""
        return next((part for part in location.split(":") if part in self.vessels), None)

    def flow_scale(self, vessel: str) -> float:
        """Return the mean flow of a vessel, at least a millionth of the largest; the largest if it is unknown."""
        largest = max((abs(q) for q in self.flow.values()), default=1.0) or 1.0
        return max(abs(self.flow.get(vessel, largest)), 1e-6 * largest)


def _members(junction: dict, side: str, names: dict[int, str]) -> list[str]:
    """Return the vessels on one side of a junction, given by id (`inlet_vessels`) or by name (`inlet_blocks`)."""
    return [names[i] for i in junction.get(f"{side}_vessels", [])] + list(junction.get(f"{side}_blocks", []))
