"""The 0D side of 3D runs with adopted effects: which of them it has, and which lie inside the 3D lumen."""

from collections.abc import Sequence
from dataclasses import replace

from coronaryuq.adoption.network import with_mixtures
from coronaryuq.case.network.network import UNCERTAIN, Network
from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.mesh.coupling.cut_network import cut_network
from coronaryuq.flow3d.mesh.description import MeshDescription
from coronaryuq.zerod.effect_mixture import KIND, EffectMixture, Member
from coronaryuq.zerod.network.numbering import Model

INSIDE = "it lies inside the 3D domain, whose lumen does not have it: 3D runs are made without it"


def for_3d(tuned: Network, case: Network, mesh: MeshDescription) -> tuple[Network, dict[str, str]]:
    """Return the tuned loop for 3D runs, and why an effect does not act in it, by its label.

    Parameters
    ----------
    tuned
        The tuned loop at hyperaemia, with adopted effects.
    case
        The case's network: vessels with their own losses, without effects.
    mesh
        The domain that replaces part of it.
    """
    entries = tuned.get(UNCERTAIN, [])
    mixtures = [EffectMixture.read(one, UNCERTAIN, "network") for one in entries if one["kind"] == KIND]
    plain = _like(case, tuned)
    refused: dict[str, str] = {}
    kept = []
    for mixture in mixtures:
        members = []
        for member in mixture.members:
            acts = member.acts and _fits(plain, tuned, mixture, member, mesh)
            if member.acts and not acts:
                refused[f"{member.effect.replace('_', ' ')} at {member.place}"] = INSIDE
            members.append(replace(member, acts=acts))
        kept.append(replace(mixture, members=tuple(members)))
    found = with_mixtures(plain, tuned, kept)
    found[UNCERTAIN] = _columns(entries, found, kept)
    unknowns = set(Model(found).variables)
    state = tuned.get("initial_condition", {})
    pressures = [value for name, value in state.items() if name.startswith("pressure:")]
    found["initial_condition"] = {name: value for name, value in state.items() if name in unknowns}
    if pressures:
        found["initial_condition"]["pressure_all"] = sum(pressures) / len(pressures)
    return found, refused


def _columns(entries: Sequence[dict], found: Network, kept: Sequence[EffectMixture]) -> list[dict]:
    """Return the entries of the loop for 3D; a mixture that does not act keeps its columns, which change nothing."""
    acting = {one["name"]: one for one in found.get(UNCERTAIN, [])}
    still = {one.name: one.content() for one in kept}
    return [acting.get(one["name"], still[one["name"]]) if one["kind"] == KIND else one for one in entries]


def _like(case: Network, tuned: Network) -> Network:
    """Return the case's network with the tuned values of its beds and of the heart."""
    found = case.deep_copy()
    known = {block["bc_name"]: block["bc_values"] for block in tuned.boundary_conditions}
    for block in found.boundary_conditions:
        block["bc_values"] = dict(known[block["bc_name"]])
    if found.closed_loop:
        found.heart["parameters"] = dict(tuned.heart["parameters"])
        own = {name: value for one in _mixtures(tuned) for name, value in one.absent.items()}
        for name in found.heart["parameters"]:
            if f"CLH.{name}" in own:
                found.heart["parameters"][name] = own[f"CLH.{name}"]
    found["simulation_parameters"] = dict(tuned["simulation_parameters"])
    found.pop(UNCERTAIN, None)
    return found


def _mixtures(network: Network) -> list[EffectMixture]:
    return [EffectMixture.read(one, UNCERTAIN, "network") for one in network.get(UNCERTAIN, []) if one["kind"] == KIND]


def _fits(plain: Network, tuned: Network, mixture: EffectMixture, member: Member, mesh: MeshDescription) -> bool:
    """Return whether all that a member sets lies outside the mesh, and the loop remains one."""
    alone = replace(mixture, members=(replace(member, probability=1.0),))
    network = with_mixtures(plain, tuned, [alone])
    (entry,) = [one for one in network.get(UNCERTAIN, []) if one["name"] == mixture.name]
    (held,) = (one["absent"] for one in entry["members"])
    try:
        cut = cut_network(network, mesh)
        Model(cut.network)
    except InputError:
        return False
    for target in held:
        block, _, name = target.rpartition(".")
        parts = cut.parts.get(block, [(block, {name: 1.0})])
        if not parts or (len(parts) > 1 and any(name not in shares for _, shares in parts)):
            return False
    return True
