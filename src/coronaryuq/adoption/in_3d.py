"""3D runs with adopted effects: which of them the 0D side has, which the lumen, and which neither."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from coronaryuq.adoption.network import with_mixtures
from coronaryuq.case.anatomy.tree import Tree, placed_stenoses
from coronaryuq.case.case_json import CaseStenosis
from coronaryuq.case.network.along_tree import vessels_along
from coronaryuq.case.network.build import Physics
from coronaryuq.case.network.network import NARROWED, UNCERTAIN, Network
from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.mesh.coupling.cut_network import cut_network
from coronaryuq.flow3d.mesh.description import MeshDescription
from coronaryuq.flow3d.narrowed_lumen import QUADRATIC
from coronaryuq.flow3d.narrowed_network import SHAPES, Place, content, where
from coronaryuq.zerod.effect_mixture import KIND, EffectMixture, Member
from coronaryuq.zerod.network.numbering import Model

INSIDE = "it lies inside the 3D domain, whose lumen does not have it: 3D runs are made without it"


@dataclass(frozen=True)
class In3D:
    """The loop for 3D runs.

    Parameters
    ----------
    network
        svZeroDSolver JSON with the effects on the 0D side, and those in the lumen as its part `narrowed`.
    lumen
        Label of an effect in the lumen → where it is, and what of this is assumed.
    refused
        Label of an effect that 3D runs do not have → why.
    """

    network: Network
    lumen: dict[str, str]
    refused: dict[str, str]


def for_3d(tuned: Network, case: Network, mesh: MeshDescription, places: Mapping[str, Place], physics: Physics) -> In3D:
    """Return the tuned loop for 3D runs.

    Parameters
    ----------
    tuned
        The tuned loop at hyperaemia, with adopted effects.
    case
        The case's network: vessels with their own losses, without effects.
    mesh
        The domain that replaces part of it.
    places
        0D vessel → where it lies along the centrelines.
    physics
        Blood and K_t, by which the loss of a stenosis tells its throat.
    """
    entries = tuned.get(UNCERTAIN, [])
    mixtures = [EffectMixture.read(one, UNCERTAIN, "network") for one in entries if one["kind"] == KIND]
    plain = _like(case, tuned)
    lumen: dict[str, str] = {}
    refused: dict[str, str] = {}
    narrowed: dict[tuple[str, int], Place] = {}
    kept = []
    for mixture in mixtures:
        members = []
        for number, member in enumerate(mixture.members):
            label = f"{member.effect.replace('_', ' ')} at {member.place}"
            place = _narrows(plain, member, mesh, places) if member.acts else None
            acts = member.acts and place is None and _fits(plain, tuned, mixture, member, mesh)
            if place is not None:
                narrowed[mixture.name, number] = place
                inside = where(member.effect, member.place, place)
                lumen |= {label: inside} if inside else {}
            elif member.acts and not acts:
                refused[label] = INSIDE
            members.append(replace(member, acts=acts))
        kept.append(replace(mixture, members=tuple(members)))
    found = with_mixtures(plain, tuned, kept)
    found[UNCERTAIN] = _columns(entries, found, kept)
    if narrowed:
        found[NARROWED] = content(narrowed, physics)
    unknowns = set(Model(found).variables)
    state = tuned.get("initial_condition", {})
    pressures = [value for name, value in state.items() if name.startswith("pressure:")]
    found["initial_condition"] = {name: value for name, value in state.items() if name in unknowns}
    if pressures:
        found["initial_condition"]["pressure_all"] = sum(pressures) / len(pressures)
    return In3D(found, lumen, refused)


def places_along(
    tree: Tree, stenoses: Sequence[CaseStenosis], network: Network, mesh: MeshDescription, file: str = "network"
) -> dict[str, Place]:
    """Return where the 0D vessels along the meshed part of the tree lie; the lesion of several is the tightest."""
    kept = {name: interval for piece in mesh.pieces for name, interval in piece.items()}
    lesions: dict[str, tuple[float, float]] = {}
    for stenosis in sorted(stenoses, key=lambda one: one.area_ratio or 1.0, reverse=True):
        if stenosis.start is not None and stenosis.end is not None:
            lesions[stenosis.segment] = stenosis.start, stenosis.end
    return {
        one.name: Place.of(tree[one.vessel], one.start, one.end, kept[one.vessel], lesions.get(one.name))
        for one in vessels_along(tree, placed_stenoses(stenoses), network, file)
        if one.vessel in kept
    }


def _narrows(plain: Network, member: Member, mesh: MeshDescription, places: Mapping[str, Place]) -> Place | None:
    """Return where a vessel lies that the effect narrows in the mesh, None if it narrows none there."""
    inside = member.place in mesh.replaces or member.place in mesh.cut
    if member.effect not in SHAPES or not inside or member.place not in places:
        return None
    return places[member.place] if plain.vessel_values(member.place)["R_poiseuille"] > 0.0 else None


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
        if name == QUADRATIC and block in mesh.cut:  # what stays of it in 0D is the entrance's
            return False
    return True
