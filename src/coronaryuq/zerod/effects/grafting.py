"""Vessels and junctions added to a 0D network without disturbing the flow through it.

An added vessel has a stem, such as `LAD_leak` for a stub of `LAD` or `leak~LAD` for a leak there, by which its effect
finds it again. With `_` for `~` that is its name, too, unless the network has a vessel, bed or junction of that name.
"""

from collections.abc import Callable, Iterable

from coronaryuq.case.network.network import GRAFTED, Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Effect

DISTAL = "distal"
"""Suffix of stubs beyond the probes."""


def with_elements(
    network: Network, effects: Iterable[tuple[Effect, str]], anatomy_of: Callable[[Network], Anatomy]
) -> tuple[Network, dict[str, str]]:
    """Return the network with the elements of effects, each with its place, and old → new names of locations.

    The order in which they are given does not matter: they are inserted by name, those beyond the probes last.
    anatomy_of: returns the anatomy of a network.
    """
    renamed: dict[str, str] = {}
    for one, place in sorted(effects, key=lambda placed: (placed[0].beyond_probes, placed[0].name, placed[1])):
        anatomy = anatomy_of(network)
        if one.inserts(place, anatomy):
            renamed = renamed_again(renamed, one.aliases(place, anatomy))
            network = one.insert(network, place, anatomy)
    return network, renamed


def grafted(network: Network, stem: str) -> str | None:
    """Return the name of the vessel that was added under a stem; None if there is none."""
    return next((vessel["vessel_name"] for vessel in network.vessels if vessel.get(GRAFTED) == stem), None)


def grafted_name(network: Network, stem: str) -> str:
    """Return the name of the vessel of a stem, whether it is there already or is to be added.

    Its bed is `BC_NAME`, its junction `J_NAME`; the name has as few underscores at its end as leave all three free.
    """
    if present := grafted(network, stem):
        return present
    name, taken = stem.replace("~", "_"), network.names
    while taken & {name, f"BC_{name}", f"J_{name}"}:
        name += "_"
    return name


def open_end(network: Network, vessel: str, tag: str) -> tuple[Network, str, dict[str, str]]:
    """Give the end of a vessel a junction to which vessels can be attached.

    A vessel that ends in a plain junction keeps it. One that ends in a bed gets a junction and a lossless stub
    `VESSEL_TAG` to the bed; the location `VESSEL:BED`, the flow into the bed, becomes `VESSEL_TAG:BED`. One that ends
    in a junction with its own values, to which no vessels can be added, gets a stub to that junction; the location
    becomes that of the vessel's end ahead of the stub. With the tag `DISTAL` the bed of an outlet vessel gets the stub,
    behind those of other effects, and its probes stay ahead of it.

    Returns
    -------
    network, junction, renamed
        The new network, the name of the junction, and old → new names of locations.
    """
    network = network.deep_copy()
    anatomy = Anatomy(network)
    renamed, opened = locations_renamed(anatomy, vessel, tag), _opened(anatomy, vessel, tag)
    if not renamed:
        return network, anatomy.downstream[opened], {}
    stem = f"{vessel}_{tag}"
    stub = grafted_name(network, stem)
    junction = f"J_{stub}"
    parent = network.vessel(opened)
    if opened in anatomy.outlet_bc:
        del parent["boundary_conditions"]["outlet"]
        if not parent["boundary_conditions"]:
            del parent["boundary_conditions"]
        number = add_vessel(network, stem, {"R_poiseuille": 0.0}, outlet=anatomy.outlet_bc[opened])
    else:
        number = add_vessel(network, stem, {"R_poiseuille": 0.0})
        _reconnect(network.junction(anatomy.downstream[opened]), "inlet", parent, number, stub)
    _add_junction(network, junction, parent["vessel_id"], number)
    return network, junction, renamed


def locations_renamed(anatomy: Anatomy, vessel: str, tag: str) -> dict[str, str]:
    """Return old name → new name of the location that `open_end` renames."""
    opened = _opened(anatomy, vessel, tag)
    end, stub = anatomy.downstream[opened], grafted_name(anatomy.network, f"{vessel}_{tag}")
    if opened in anatomy.outlet_bc and tag != DISTAL:
        return {f"{opened}:{end}": f"{stub}:{end}"}
    if opened in anatomy.outlet_bc or "junction_values" in anatomy.network.junction(end):
        return {f"{opened}:{end}": f"{opened}:J_{stub}"}
    return {}


def _opened(anatomy: Anatomy, vessel: str, tag: str) -> str:
    """Return the vessel that `open_end` opens at its end: the last one ahead of a `DISTAL` stub, or `vessel` itself."""
    if tag != DISTAL:
        return vessel
    if stub := grafted(anatomy.network, f"{vessel}_{DISTAL}"):
        return anatomy.parents(stub)[0]
    # Breadth first, the stub to the vessel's own bed comes before what effects have attached to its end.
    return anatomy.vessel_of[anatomy.outlets_below(vessel)[0]]


def into_bed(location: str, bed: str) -> str:
    """Return where blood enters a bed, given the location of the probes at the end of its vessel after `open_end`."""
    _, end = location.split(":")
    return location if end == bed else f"{end.removeprefix('J_')}:{bed}"


def put_ahead(network: Network, vessel: str, tag: str, stem: str = "") -> Network:
    """Return the network with a lossless vessel between a vessel and its feeder; stem: `VESSEL_TAG` if not given.

    The location where the vessel began, `FEEDER:VESSEL`, becomes `FEEDER:VESSEL_TAG`.
    """
    network = network.deep_copy()
    stem = stem or f"{vessel}_{tag}"
    stub = grafted_name(network, stem)
    below = network.vessel(vessel)
    inlet = below.get("boundary_conditions", {}).pop("inlet", None)
    number = add_vessel(network, stem, {"R_poiseuille": 0.0}, **({"inlet": inlet} if inlet else {}))
    for feeder in [*network.junctions, *network.get("closed_loop_blocks", [])]:
        _reconnect(feeder, "outlet", below, number, stub)
    _add_junction(network, f"J_{stub}", number, below["vessel_id"])
    return network


def put_behind(network: Network, vessel: str, stem: str) -> str:
    """Put a lossless vessel between a vessel of a network and what that feeds, in place; return its name.

    The location where the vessel ended, `VESSEL:END`, becomes that of the added one.
    """
    name, above = grafted_name(network, stem), network.vessel(vessel)
    outlet = above.get("boundary_conditions", {}).pop("outlet", None)
    number = add_vessel(network, stem, {"R_poiseuille": 0.0}, **({"outlet": outlet} if outlet else {}))
    for fed in network.junctions:
        _reconnect(fed, "inlet", above, number, name)
    _add_junction(network, f"J_{name}", above["vessel_id"], number)
    return name


def _add_junction(network: Network, name: str, inlet: int, outlet: int) -> None:
    network.setdefault("junctions", []).append(
        {
            "junction_name": name,
            "junction_type": "NORMAL_JUNCTION",
            "inlet_vessels": [inlet],
            "outlet_vessels": [outlet],
        }
    )


def _reconnect(block: dict, side: str, vessel: dict, number: int, name: str) -> None:
    """Connect a junction or heart to the vessel `number`, `name` instead of `vessel`."""
    for key, old, new in (
        (f"{side}_vessels", vessel["vessel_id"], number),
        (f"{side}_blocks", vessel["vessel_name"], name),
    ):
        if key in block:
            block[key] = [new if entry == old else entry for entry in block[key]]


def add_vessel(network: Network, stem: str, values: dict[str, float], **ends: str) -> int:
    """Append a vessel with the element `values` and boundary conditions `inlet=`, `outlet=`; return its id.

    A bed of its own is to be added behind it, so that its name is chosen while that of the bed is free.
    """
    number = 1 + max(network.vessel_names)
    vessel = {
        "vessel_id": number,
        "vessel_name": grafted_name(network, stem),
        "vessel_length": 0.0,
        "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": dict(values),
        GRAFTED: stem,
    }
    if ends:
        vessel["boundary_conditions"] = dict(ends)
    network["vessels"].append(vessel)
    return number


def attach(network: Network, junction: str, side: str, vessel_id: int) -> None:
    """Connect a vessel to a junction, on the side "inlet" if it brings flow, "outlet" if it takes flow away.

    A junction written by block names gets the name instead of the number.
    """
    block = network.junction(junction)
    if f"{side}_blocks" in block:
        block[f"{side}_blocks"].append(network.vessel_names[vessel_id])
    else:
        block[f"{side}_vessels"].append(vessel_id)


def detach_outlet(network: Network, junction: str, vessel: str) -> None:
    """Remove a vessel from the outlets of a junction, and its own values there."""
    block = network.junction(junction)
    position = network.junction_sides(block)[1].index(vessel)
    lists = [*block.get("junction_values", {}).values(), block.get("outlet_vessels"), block.get("outlet_blocks")]
    for entries in lists:
        if entries:
            del entries[position]


def renamed_again(renamed: dict[str, str], fresh: dict[str, str]) -> dict[str, str]:
    """Return old → new names of locations after a further change, which renames some of the new ones or others."""
    later = {old: new for old, new in fresh.items() if old not in renamed.values()}
    return {old: fresh.get(new, new) for old, new in renamed.items()} | later
