"""The lumens and blood of a batch of samples: nodes on the mesh's topology, viscosity, what is left of cut vessels."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from coronaryuq.case.lumen.profiles import Lumen
from coronaryuq.case.network.network import Network
from coronaryuq.flow3d.mesh.description import MeshDescription
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.morph.morph import Morph
from coronaryuq.flow3d.mesh.read_mesh import Domain
from coronaryuq.flow3d.mesh.remesh import Remeshed, Remesher
from coronaryuq.flow3d.narrowed_lumen import QUADRATIC, NarrowedLumen


@dataclass(frozen=True)
class Shapes:
    """The lumens of some samples.

    Parameters
    ----------
    points
        (samples, n, 3) nodes, cm.
    viscosity
        (samples,) of blood, poise.
    outside
        "VESSEL.parameter" → (samples,) of each vessel that the mesh cuts, what its part outside changes by over what
        the whole changes by; the downstream part of a vessel with two is called VESSEL_downstream.
    reasons
        (samples,) why a sample has no valid mesh, empty if it has; the others' nodes are then those of the mesh.
    quality
        (samples,) quality of the elements.
    remeshed
        Sample → its own mesh, where the nodes of the segmented lumen's cannot follow.
    added
        As `outside` → (samples,) what a throat that lies in this part adds to its coefficient, after the factor.
    whole
        "VESSEL.parameter" → (samples,) what narrowings in the mesh add to whole 0D vessels, for the full loop from
        whose periodic state a run starts.
    """

    points: np.ndarray
    viscosity: np.ndarray
    outside: Mapping[str, np.ndarray]
    reasons: list[str]
    quality: list[dict[str, Any]]
    remeshed: Mapping[int, Remeshed] = field(default_factory=dict)
    added: Mapping[str, np.ndarray] = field(default_factory=dict)
    whole: Mapping[str, np.ndarray] = field(default_factory=dict)

    def of(self, members: list[int]) -> "Shapes":
        """Return the lumens of some of the samples."""
        tables = (self.outside, self.added, self.whole)
        outside, added, whole = ({name: value[members] for name, value in table.items()} for table in tables)
        pick = [self.reasons[k] for k in members], [self.quality[k] for k in members]
        remeshed = {k: self.remeshed[member] for k, member in enumerate(members) if member in self.remeshed}
        return Shapes(self.points[members], self.viscosity[members], outside, *pick, remeshed, added, whole)

    def alone(self, member: int) -> "Shapes":
        """Return the lumen of a sample that has a mesh of its own, on that mesh."""
        points = self.remeshed[member].domain.points[None]
        return replace(self.of([member]), points=points, remeshed={})

    def domain(self, member: int, shared: Domain) -> Domain:
        """Return the mesh of a sample: its own one, or the shared one with its nodes."""
        if member in self.remeshed:
            return self.remeshed[member].domain
        return replace(shared, points=self.points[member])

    def start(self, changes: Mapping[str, np.ndarray], loop: Network) -> dict[str, np.ndarray]:
        """Return the changes (samples,) of the full loop from whose periodic state a run starts."""
        return _changed(changes, loop, {}, self.whole)

    def beside(self, changes: Mapping[str, np.ndarray], loop: Network) -> dict[str, np.ndarray]:
        """Return the changes (samples,) of the loop without the mesh."""
        return _changed(changes, loop, self.outside, self.added)


def _changed(
    changes: Mapping[str, np.ndarray], loop: Network, factors: Mapping[str, np.ndarray], added: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    found = dict(changes)
    for name in {**factors, **added}:
        vessel, _, parameter = name.rpartition(".")
        present = found.get(name, loop.vessel_values(vessel).get(parameter, 0.0))
        found[name] = factors.get(name, 1.0) * present + added.get(name, 0.0)
    return found


@dataclass(frozen=True)
class Meshes:
    """The ways to the mesh of a drawn lumen: moved nodes, and where these fail a mesh of its own."""

    morph: Morph
    remesher: Remesher


def draw_shapes(
    domain: Domain, meshes: Meshes | None, viscosity: np.ndarray, theta: Mapping[str, np.ndarray], samples: int
) -> Shapes:
    """Return the lumens of samples from columns (samples,) of θ; absent coordinates are at their centre.

    meshes: None if the lumen is that of the mesh; viscosity: (samples,) poise.
    """
    points, reasons = np.array([domain.points] * samples), [""] * samples
    quality: list[dict[str, Any]] = [{} for _ in range(samples)]
    if meshes is None:
        return Shapes(points, viscosity, {}, reasons, quality)
    morph, remeshed = meshes.morph, {}
    names = [name for name in morph.lumen.names if name in theta]
    given = {name: np.broadcast_to(np.asarray(theta[name], float), (samples,)) for name in names}
    for k in range(samples):
        z = {name: float(value[k]) for name, value in given.items()}
        try:
            moved = morph(z)
            points[k], quality[k] = moved.points, moved.quality
        except MeshError as spoilt:
            try:
                remeshed[k] = meshes.remesher(z)
                quality[k] = remeshed[k].quality | {"remeshed_because": str(spoilt)}
            except MeshError as error:
                reasons[k] = f"{spoilt}; {error}"
    # The factors of a vessel none of whose coordinates is given are those of one sample, the centre.
    factors = outside_factors(morph.lumen, domain.description, given)
    added: dict[str, np.ndarray] = {}
    whole: dict[str, np.ndarray] = {}
    if isinstance(morph.lumen, NarrowedLumen):
        own, added = morph.lumen.outside(domain.description, given)
        factors |= {name: factor * factors.get(name, 1.0) for name, factor in own.items()}
        whole = morph.lumen.additions(given)
    outside, added, whole = (
        {name: np.broadcast_to(value, (samples,)) for name, value in table.items()} for table in (factors, added, whole)
    )
    return Shapes(points, viscosity, outside, reasons, quality, remeshed, added, whole)


def outside_factors(lumen: Lumen, description: MeshDescription, z: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return `Shapes.outside` of the vessels that a mesh cuts; of length 1 where no coordinate of a vessel is given."""
    kept = {name: interval for piece in description.pieces for name, interval in piece.items()}
    found: dict[str, np.ndarray] = {}
    for vessel, cut in description.cut.items():
        profile = lumen.profiles.get(vessel)
        if profile is None:
            continue
        start, end = profile.law.arc[[0, -1]]
        first, last = kept[profile.vessel]
        whole = profile.factors(z)
        second = f"{vessel}_downstream" if cut.upstream is not None else vessel
        for name, side, part in ((vessel, cut.upstream, (start, first)), (second, cut.downstream, (last, end))):
            # A cap at the ostium leaves no length outside, only the entrance.
            lengths = [key for key, share in (side or {}).items() if share and key in whole and key != QUADRATIC]
            if lengths:
                own = profile.between(*part)
                factors = own.factors(z)
                # The mesh's shares are those of the segmented lumen; the network's values are those at the centre.
                centre = {key: own.centre()[key] / profile.centre()[key] for key in lengths}
                found |= {f"{name}.{key}": factors[key] / whole[key] * centre[key] for key in lengths}
        if profile.entrance and cut.upstream is not None:
            speed = lumen.ratio(profile.vessel, first, z)[:, 0] ** -4.0
            found[f"{vessel}.{QUADRATIC}"] = speed / (whole[QUADRATIC] * profile.centre()[QUADRATIC])
    return found
