"""What was understood of a case's vessels, as far as its files could be read: every end with its role."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from coronaryuq.case.anatomy.read import PlacedOutlets
from coronaryuq.case.anatomy.synthetic_aorta import is_aorta
from coronaryuq.case.anatomy.tree import AORTA, Stenosis, Tree, Vessel
from coronaryuq.case.case_json import CaseOutlet, CaseWirePlace
from coronaryuq.case.perfusion.perfusion_map import Wall
from coronaryuq.case.tables.read import OutletRow
from coronaryuq.core.units import LENGTHS


@dataclass(frozen=True)
class EndRole:
    """An end of the tree: its vessel, the name and label of its row, its artery (None: no row) and what it feeds."""

    vessel: Vessel
    name: str
    label: str
    artery: str | None
    feeds: str

    def __str__(self) -> str:
        label = "" if self.label == self.name else f" = {self.label}"
        return f"{self.name}{label} ({self.feeds}, {20 * self.vessel.radii[-1]:.1f} mm)"


@dataclass
class Sketch:
    """Parts of a case in the order in which they are read; those behind a fault are missing.

    Attributes
    ----------
    rows
        Rows of the outlets table.
    tree, placed, stenoses
        Vessels, their ends' outlets, stenoses.
    outlets, wire_places, wall
        Coronary outlets of the finished case, places of a pressure wire, the left ventricular wall.
    beds
        Of a network whose outlets table has a fault: vessel → name of the coronary bed at its end.
    scan
        Scan to which the perfusion map was registered, and its length unit, cm; None if it was not.
    unit
        Length unit of the anatomy; None without an anatomy.
    file
        The `case.yaml`.
    """

    rows: Sequence[OutletRow] = ()
    tree: Tree | None = None
    placed: PlacedOutlets | None = None
    stenoses: list[Stenosis] = field(default_factory=list)
    outlets: list[CaseOutlet] = field(default_factory=list)
    wire_places: list[CaseWirePlace] = field(default_factory=list)
    wall: Wall | None = None
    beds: dict[str, str] = field(default_factory=dict)
    scan: tuple[Path, float] | None = None
    unit: str | None = None
    file: Path | None = None

    def roles(self) -> list[EndRole]:
        """Return the ends of the tree with their roles."""
        if self.tree is None:
            return []
        rows = {self._vessel_of(row): row for row in self.rows}
        systemic = {} if self.placed is None else {vessel: bc for bc, vessel in self.placed.systemic.items()}
        roles = []
        for vessel in self.tree.leaves():
            row = rows.get(vessel.name)
            if row is not None:
                roles.append(EndRole(vessel, row.name, row.label, row.branch, row.perfuses))
            elif vessel.name in self.beds:
                bed = self.beds[vessel.name]
                roles.append(EndRole(vessel, bed, bed, None, f"vessel {vessel.name}"))
            elif vessel.name in systemic or vessel.made or is_aorta(vessel) or self.outlets or self.beds:
                made = "added for the 0D loop" if vessel.made else systemic.get(vessel.name, "systemic")
                roles.append(EndRole(vessel, vessel.name, vessel.name, AORTA, made))
            else:
                roles.append(EndRole(vessel, vessel.name, vessel.name, None, "no row in the outlets table"))
        return roles

    def _vessel_of(self, row: OutletRow) -> str:
        """Return the vessel of a row as far as it is known."""
        blocks = {outlet.name: outlet.vessel for outlet in self.outlets}
        if self.placed is not None:
            blocks |= self.placed.vessels
        return blocks.get(row.name) or row.vessel or row.name

    def lines(self) -> list[str]:
        """Return sizes in the given unit beside those in others, and the ends by artery."""
        roles = self.roles()
        lines = self._unit_line(roles)
        for artery in dict.fromkeys(role.artery for role in roles):
            own = "; ".join(str(role) for role in roles if role.artery == artery)
            unknown = "ends whose artery is not read" if self.beds else "ends without a row"
            lines.append(f"ends of the {artery}: {own}" if artery else f"{unknown}, what are they? {own}")
        return lines

    def _unit_line(self, roles: Sequence[EndRole]) -> list[str]:
        assert self.tree is not None or not roles
        widths = [2 * float(role.vessel.radii[-1]) for role in roles if role.artery != AORTA]
        if self.unit is None or not widths:
            return []
        low, high = min(widths) / LENGTHS[self.unit], max(widths) / LENGTHS[self.unit]

        def shown(unit: str) -> str:
            return " to ".join(f"{float(f'{10 * width * LENGTHS[unit]:.2g}'):g}" for width in (low, high)) + " mm"

        others = [f"if {unit}, {shown(unit)}" for unit in LENGTHS if unit != self.unit]
        return [
            f"unit: coronary ends of {shown(self.unit)} in diameter: is the unit {self.unit}? ({'; '.join(others)})"
        ]
