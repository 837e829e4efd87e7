"""Networks on which effects can act."""

from pathlib import Path

from coronaryuq.case.network.network import GRAFTED, Network
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.effects.quadratic import TAG
from coronaryuq.zerod.effects.stenosis import FOCAL

MARKS = (":", "~", "<", ">", " and ", " towards ", " with ", " from ", " under ", " but ")
"""Separators of the blocks of a place, and of a place and a condition."""
NEVER_NEGATIVE = ("R_poiseuille", "L", "C")
"""Values of a vessel; a stenosis coefficient is negative where a vessel widens, as one learned from 3D may be."""


def as_searched(network: Network) -> Network:
    """Return a network with the vessels of an earlier search as the patient's own, so that effects may act there again.

    Those that hold the loss of the vessel behind them keep their mark: a further loss of that vessel is added to it.
    """
    network = network.deep_copy()
    for vessel in network.vessels:
        if not vessel.get(GRAFTED, "").endswith((f"_{TAG}", f"_{FOCAL}")):
            vessel.pop(GRAFTED, None)
    return network


def check_searchable(network: Network, file: str | Path) -> None:
    """Raise `InputError` if the network contains what no effect can act on; `file` for messages.

    Places are written BLOCK:BLOCK, BED~BED, BED<BED, VESSEL>VESSEL, VESSEL from VESSEL and so on, so that no name may
    contain these separators.
    """
    if not network.vessels:
        raise InputError(file, "vessels", None, "missing; there is no vessel or bed that an effect could act on")
    for block in network.couplings:
        remedy = (
            "coupled to an external solver, which the search does not support; replace it with a boundary condition"
        )
        raise InputError(file, f"external_solver_coupling_blocks.{block['name']}", None, remedy)
    for vessel in network.vessels:
        if vessel["zero_d_element_type"] == "BloodVesselRC":
            remedy = "element not supported by the search; use BloodVessel, or BloodVesselCRL with R_poiseuille and C"
            raise InputError(file, vessel["vessel_name"], "BloodVesselRC", remedy)
        for name in NEVER_NEGATIVE:
            value = vessel["zero_d_element_values"].get(name, 0.0)
            if value < 0.0:
                where = f"vessels.{vessel['vessel_name']}.{name}"
                raise InputError(file, where, value, "expected a value of zero or more")
    for part, key in (("vessels", "vessel_name"), ("boundary_conditions", "bc_name"), ("junctions", "junction_name")):
        for block in network.get(part, []):
            for mark in MARKS:
                if mark in block[key]:
                    raise InputError(file, f"{part}.{key}", block[key], f"expected a name without {mark.strip()!r}")
