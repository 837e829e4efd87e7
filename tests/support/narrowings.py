"""The tube of `support.loops`, longer, with adopted narrowings in its lumen."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.anatomy.tree import Tree, Vessel
from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.lumen.law import lumen_law
from coronaryuq.case.lumen.profiles import with_lumen
from coronaryuq.case.network.build import Physics, Segment, elements
from coronaryuq.case.network.network import ENTRANCE, NARROWED, UNCERTAIN
from coronaryuq.core.units import BLOOD_DENSITY as DENSITY
from coronaryuq.core.units import BLOOD_VISCOSITY as VISCOSITY
from coronaryuq.flow3d.adapter import FlowModel
from coronaryuq.flow3d.mesh.description import MeshDescription, Remainder
from coronaryuq.flow3d.mesh.read_mesh import Domain
from coronaryuq.flow3d.narrowed_network import Place, content
from coronaryuq.flow3d.verification.tube import tube
from coronaryuq.zerod.effect_mixture import EffectMixture, Member
from support.loops import RADIUS, domain, network

LENGTH = 2.4
FLOW = 1.5
SCALES = {"pressure": 1.2e5, "period": 0.5, "flow": {"B": FLOW}}
SIZE, MEMBER = "missing_1_size", "missing_1_member"


def member(effect: str, sizes: int = 1, probability: float = 1.0, mean: float = 0.0, sd: float = 0.5) -> Member:
    """A member that does not act in 0D, as in the network for 3D runs."""
    covariance = tuple(map(tuple, (sd**2 * np.eye(sizes)).tolist()))
    return Member(effect, "B", probability, False, (mean,) * sizes, covariance, {})


def narrowed(
    members: Sequence[Member],
    in_lumen: Sequence[int] = (0,),
    lesion: tuple[float, float] | None = None,
    error: LumenError | None = None,
    radii: np.ndarray | None = None,
    rings: int = 3,
    meshed: tuple[float, float] = (0.0, LENGTH),
    entrance: float = 0.0,
) -> FlowModel:
    """The loop with an effect of B that is one of `members`, of which those `in_lumen` narrow it.

    meshed: the part of B in 3D, which the mesh cuts if it is not the whole; its nodes are those of the whole. entrance:
    share of the stenosis coefficient of B that speeds the blood up.
    """
    z = np.linspace(0.0, LENGTH, 121)
    own = np.full(len(z), RADIUS) if radii is None else radii
    tree = Tree([Vessel("B", z[:, None] * [0.0, 0.0, 1.0], own, None, "LAD")])
    loop = network()
    loop.vessel_values("B").update({k: v for k, v in elements(tree["B"], Physics()).items() if k != "C"})
    loop.vessel("B")["vessel_length"] = LENGTH
    if entrance:
        loop.vessel("B")[ENTRANCE] = entrance
        loop.vessel_values("B")["stenosis_coefficient"] = 100.0
    if error is not None:
        loop = with_lumen(loop, tree, [Segment("B", "B", 0.0, LENGTH)], lumen_law(tree, [], error))
    mixture = EffectMixture("missing_1", tuple(members), SCALES)
    loop[UNCERTAIN] = [*loop.get(UNCERTAIN, []), mixture.content()]
    place = Place.of(tree["B"], 0.0, LENGTH, meshed, lesion)
    loop[NARROWED] = content(dict.fromkeys([("missing_1", k) for k in in_lumen], place), Physics())
    points, tets, faces = tube(LENGTH, lambda at: np.interp(at, z, own), rings, 15 * rings)
    caps = {name: faces[name] for name in ("inlet", "outlet")}
    short = domain().description
    described = MeshDescription(faces=short.faces, replaces=["B"], pieces=[{"B": meshed}], regions={}, planes={})
    if meshed != (0.0, LENGTH):
        shares = [dict.fromkeys(("R_poiseuille", "L", "C"), part / LENGTH) for part in (meshed[0], LENGTH - meshed[1])]
        sides = [share | {"stenosis_coefficient": entrance} if share["L"] else None for share in shares]
        cut = Remainder(upstream=sides[0], downstream=sides[1])
        described = described.model_copy(update={"replaces": [], "cut": {"B": cut}})
    plane = (np.array([0.0, 0.0, 0.9 * LENGTH]), np.array([0.0, 0.0, 1.0]))
    wall = faces["wall"]
    shape = Domain(points, tets, caps, ["inlet"], {"LAD": wall[: len(wall) // 2]}, {"LAD": plane}, described)
    return FlowModel(shape, loop, "A:J0", DENSITY, VISCOSITY, tree=tree)
