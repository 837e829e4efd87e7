"""Adding vessels and junctions to a 0D network without disturbing the flow through it."""

from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.network.read import copy_of


def open_end(network: dict, vessel: str, tag: str) -> tuple[dict, str, dict[str, str]]:
    """Give a vessel's end a junction to which something can be attached.

    Returns the new network, the junction's name and the renamed locations. A vessel that ends in a plain junction keeps
    it. One that ends in a bed gets a junction and a lossless stub `VESSEL_TAG` to that bed; its location `VESSEL:BED`,
    the flow into the bed, is from then on `VESSEL_TAG:BED`. One that ends in a junction with values of its own, which
    takes no more vessels, gets a stub to that; its location is from then on that of the vessel's end ahead of the stub.
    """
    network = copy_of(network)
    anatomy = Anatomy(network)
    renamed = opened(anatomy, vessel, tag)
    if not renamed:
        return network, anatomy.downstream[vessel], {}
    stub, junction = f"{vessel}_{tag}", f"J_{vessel}_{tag}"
    parent = next(v for v in network["vessels"] if v["vessel_name"] == vessel)
    if vessel in anatomy.outlet_bc:
        del parent["boundary_conditions"]["outlet"]
        if not parent["boundary_conditions"]:
            del parent["boundary_conditions"]
        add_vessel(network, stub, {"R_poiseuille": 0.0}, outlet=anatomy.outlet_bc[vessel])
    else:
        number = add_vessel(network, stub, {"R_poiseuille": 0.0})
        below = _junction(network, anatomy.downstream[vessel])
        for side, old, new in (("inlet_vessels", parent["vessel_id"], number), ("inlet_blocks", vessel, stub)):
            if side in below:
                below[side] = [new if one == old else one for one in below[side]]
    network.setdefault("junctions", []).append(
        {
            "junction_name": junction,
            "junction_type": "NORMAL_JUNCTION",
            "inlet_vessels": [parent["vessel_id"]],
            "outlet_vessels": [network["vessels"][-1]["vessel_id"]],
        }
    )
    return network, junction, renamed


def opened(anatomy: Anatomy, vessel: str, tag: str) -> dict[str, str]:
    """Old name → new name of the location that `open_end` renames."""
    end = anatomy.downstream[vessel]
    if vessel in anatomy.outlet_bc:
        return {f"{vessel}:{end}": f"{vessel}_{tag}:{end}"}
    if "junction_values" in _junction(anatomy.network, end):
        return {f"{vessel}:{end}": f"{vessel}:J_{vessel}_{tag}"}
    return {}


def _junction(network: dict, name: str) -> dict:
    return next(j for j in network["junctions"] if j["junction_name"] == name)


def put_ahead(network: dict, vessel: str, tag: str) -> dict:
    """The network with a lossless vessel `VESSEL_TAG` between a vessel and what feeds it.

    The location where the vessel began, `FEEDER:VESSEL`, is from then on `FEEDER:VESSEL_TAG`.
    """
    network = copy_of(network)
    stub, junction = f"{vessel}_{tag}", f"J_{vessel}_{tag}"
    below = next(v for v in network["vessels"] if v["vessel_name"] == vessel)
    inlet = below.get("boundary_conditions", {}).pop("inlet", None)
    number = add_vessel(network, stub, {"R_poiseuille": 0.0}, **({"inlet": inlet} if inlet else {}))
    for feeder in [*network.get("junctions", []), *network.get("closed_loop_blocks", [])]:
        for side, old, new in (("outlet_vessels", below["vessel_id"], number), ("outlet_blocks", vessel, stub)):
            if side in feeder:
                feeder[side] = [new if one == old else one for one in feeder[side]]
    network.setdefault("junctions", []).append(
        {
            "junction_name": junction,
            "junction_type": "NORMAL_JUNCTION",
            "inlet_vessels": [number],
            "outlet_vessels": [below["vessel_id"]],
        }
    )
    return network


def add_vessel(network: dict, name: str, values: dict[str, float], **ends: str) -> int:
    """Append a vessel with the element `values` and boundary conditions `inlet=`, `outlet=`; returns its id."""
    number = 1 + max(v["vessel_id"] for v in network["vessels"])
    vessel = {
        "vessel_id": number,
        "vessel_name": name,
        "vessel_length": 1.0,
        "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": dict(values),
    }
    if ends:
        vessel["boundary_conditions"] = dict(ends)
    network["vessels"].append(vessel)
    return number


def attach(network: dict, junction: str, side: str, vessel_id: int) -> None:
    """Connect a vessel to a junction: side "inlet" where it brings flow, "outlet" where it takes flow away.

    A junction written by block names gets the name instead of the number.
    """
    found = _junction(network, junction)
    if f"{side}_blocks" in found:
        found[f"{side}_blocks"].append(
            next(v["vessel_name"] for v in network["vessels"] if v["vessel_id"] == vessel_id)
        )
    else:
        found[f"{side}_vessels"].append(vessel_id)
