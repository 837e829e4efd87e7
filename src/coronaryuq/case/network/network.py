"""A 0D network as svZeroDSolver JSON, and its blocks by name."""

from collections.abc import Iterator
from typing import Any, NamedTuple

HEART = "CLH"
"""Name that svZeroDSolver gives the closed-loop heart block."""
HEART_TYPE = "ClosedLoopHeartAndPulmonary"
BEFORE_HEART, AFTER_HEART = "J_heart_inlet", "J_heart_outlet"
"""Junctions that svZeroDSolver puts between the heart and the blocks that return to it or that it feeds."""
UNCERTAIN = "uncertain_parameters"
"""Part of a network that svZeroDSolver does not know: see `zerod.theta`."""
VISCOSITY = "viscosity"
"""Name of the uncertain parameter that multiplies the viscosity in 3D, too."""
LUMEN = "lumen"
"""Another: see `case.lumen.profiles`."""
NARROWED = "narrowed"
"""Another: see `flow3d.narrowed_network`."""
ENTRANCE = "entrance"
"""Entry of a vessel that svZeroDSolver ignores: see `case.network.entrances`."""

Entry = dict[str, Any]

GRAFTED = "grafted"
"""Another: what the vessel of an effect is for; no vessel of the patient has it. See `zerod.effects.grafting`."""
COPY_OF = "copy_of"
"""Entry of a boundary condition that an effect added: the one that it copies, with whose values its own change."""


class Element(NamedTuple):
    """One block with parameters: its part of the file, name, type and values."""

    part: str
    name: str
    kind: str
    values: dict[str, Any]


class Network(dict[str, Any]):
    """The content of an svZeroDSolver file, with its blocks by name.

    Blocks are returned without a copy: to change one without changing the network, take a `deep_copy` first. Looking up
    an unknown name raises `KeyError`.
    """

    @property
    def vessels(self) -> list[Entry]:
        return self.get("vessels", [])

    @property
    def boundary_conditions(self) -> list[Entry]:
        return self.get("boundary_conditions", [])

    @property
    def junctions(self) -> list[Entry]:
        return self.get("junctions", [])

    @property
    def couplings(self) -> list[Entry]:
        """Blocks through which a 3D solver drives the network."""
        return self.get("external_solver_coupling_blocks", [])

    @property
    def valves(self) -> list[Entry]:
        return self.get("valves", [])

    @property
    def chambers(self) -> list[Entry]:
        """Chambers of the heart, each a separate block."""
        return self.get("chambers", [])

    @property
    def closed_loop(self) -> bool:
        return bool(self.get("closed_loop_blocks"))

    @property
    def heart(self) -> Entry:
        """The closed-loop heart block."""
        return self["closed_loop_blocks"][0]

    @property
    def copies(self) -> dict[str, list[str]]:
        """Boundary condition → those that are copies of it."""
        found: dict[str, list[str]] = {}
        for block in self.boundary_conditions:
            if COPY_OF in block:
                found.setdefault(block[COPY_OF], []).append(block["bc_name"])
        return found

    @property
    def vessel_names(self) -> dict[int, str]:
        """Vessel id → vessel name."""
        return {vessel["vessel_id"]: vessel["vessel_name"] for vessel in self.vessels}

    def vessel(self, name: str) -> Entry:
        """Return the vessel `name`."""
        return _named(self.vessels, "vessel_name", name)

    def vessel_values(self, name: str) -> dict[str, Any]:
        """Return the parameters of a vessel's element."""
        return self.vessel(name)["zero_d_element_values"]

    def bed(self, name: str) -> Entry:
        """Return the boundary condition `name`."""
        return _named(self.boundary_conditions, "bc_name", name)

    def bed_values(self, name: str) -> dict[str, Any]:
        """Return the parameters of a boundary condition."""
        return self.bed(name)["bc_values"]

    def junction(self, name: str) -> Entry:
        """Return the junction `name`."""
        return _named(self.junctions, "junction_name", name)

    def junction_sides(self, junction: Entry) -> tuple[list[str], list[str]]:
        """Return the names of the blocks at a junction's inlets and outlets, from vessel ids or block names."""
        if "inlet_vessels" in junction and "outlet_vessels" in junction:
            names = self.vessel_names
            return [names[i] for i in junction["inlet_vessels"]], [names[i] for i in junction["outlet_vessels"]]
        return list(junction.get("inlet_blocks", [])), list(junction.get("outlet_blocks", []))

    def elements(self) -> Iterator[Element]:
        """Yield every block with its parameters; a chamber and its activation function are two elements of one name."""
        for block in self.vessels:
            yield Element("vessels", block["vessel_name"], block["zero_d_element_type"], block["zero_d_element_values"])
        for block in self.boundary_conditions:
            yield Element("boundary_conditions", block["bc_name"], block["bc_type"], block["bc_values"])
        for block in self.junctions:
            yield Element("junctions", block["junction_name"], block["junction_type"], block.get("junction_values", {}))
        for block in self.couplings:
            yield Element("external_solver_coupling_blocks", block["name"], block["type"], block["values"])
        for block in self.get("closed_loop_blocks", []):
            yield Element("closed_loop_blocks", HEART, block["closed_loop_type"], block["parameters"])
        for block in self.valves:
            yield Element("valves", block["name"], block["type"], block["params"])
        for block in self.chambers:
            yield Element("chambers", block["name"], block["type"], block["values"])
            activation = block["activation_function"]
            yield Element("chambers", block["name"], activation["type"], activation)

    @property
    def names(self) -> set[str]:
        """Names of all blocks, those that svZeroDSolver adds to a closed loop included."""
        return {element.name for element in self.elements()} | {HEART, BEFORE_HEART, AFTER_HEART}

    @property
    def held(self) -> set[str]:
        """Parameters, "BLOCK.parameter", that a missing effect sets: they are not tuned."""
        members = (member for entry in self.get(UNCERTAIN, []) for member in entry.get("members", []))
        return {target for member in members if member["acts"] for target in member["absent"]}

    def for_svzerodsolver(self) -> "Network":
        """Return the network without the parts that svZeroDSolver does not know; blocks are not copied."""
        return Network({key: value for key, value in self.items() if key not in (UNCERTAIN, LUMEN, NARROWED)})

    def deep_copy(self) -> "Network":
        """Copy the network and all its blocks, much faster than the general `copy.deepcopy`."""
        return Network({key: _copied(value) for key, value in self.items()})

    def __deepcopy__(self, memo: dict[int, Any]) -> "Network":
        return self.deep_copy()


def _named(blocks: list[Entry], key: str, name: str) -> Entry:
    for block in blocks:
        if block[key] == name:
            return block
    raise KeyError(name)


def _copied(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _copied(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_copied(entry) for entry in value]
    return value
