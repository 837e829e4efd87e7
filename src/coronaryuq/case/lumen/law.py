"""The law of the true radius along every coronary centreline, as an affine function of a few normal coordinates.

The logarithm of true over segmented radius is β(s) + Σ_k a_k(s) z_k with independent standard normal z, so that no
radius is ever below zero. Everywhere the radius has the mean and standard deviation that `LumenError` states.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.case.anatomy.tree import AORTA, Stenosis, Tree, Vessel, reference_radius
from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.network.parameter_names import LUMEN

COMMON = f"{LUMEN}common"
"""Coordinate of the error that all coronary arteries share."""
REST = "_rest"
"""End of the name of an artery's last coordinate, which carries what its terms leave."""
MODES = 3
"""Coordinates of the correlated error of an artery with a stenosis, besides that of the rest."""
FINENESS = 5.0
"""Knots per correlation length, at least."""
FLOW_EXPONENT = 2.6
"""Flow of an outlet as a power of its radius (paper, section 2.3), to weigh places by their pressure loss."""
REACH = 5.0
"""Diameters downstream of a stenosis up to which its artery counts in the choice of coordinates."""


@dataclass(frozen=True)
class VesselLaw:
    """Law along one vessel: knots `arc` (n,) cm, `mean` β (n,) and `columns`, coordinate → a (n,)."""

    arc: np.ndarray
    mean: np.ndarray
    columns: Mapping[str, np.ndarray]

    def log_ratio(self, arc: np.ndarray, z: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the logarithm of true over segmented radius at arc lengths (n,) cm for coordinates (samples,).

        Absent coordinates are zero.

        Returns
        -------
        array (samples, n)
            Linear between knots.
        """
        total = np.interp(arc, self.arc, self.mean)[None, :]
        for name, column in self.columns.items():
            if name in z:
                total = total + np.asarray(z[name], float).reshape(-1, 1) * np.interp(arc, self.arc, column)
        return total


@dataclass(frozen=True)
class LumenLaw:
    """The law of a tree.

    Parameters
    ----------
    names
        Coordinates, independent and standard normal.
    vessels
        Law along each coronary vessel; a vessel that is not listed is known exactly.
    captured
        Artery → fraction of its correlated variance that its own coordinates carry, weighted by pressure loss.
    """

    names: list[str]
    vessels: Mapping[str, VesselLaw]
    captured: Mapping[str, float]

    def ratio(self, vessel: str, arc, z: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return true over segmented radius (samples, n) at arc lengths (n,) cm of a vessel; see `VesselLaw`."""
        samples = max((np.size(z[name]) for name in self.names if name in z), default=1)
        arc = np.atleast_1d(np.asarray(arc, float))
        if vessel not in self.vessels:
            return np.ones((samples, len(arc)))
        return np.broadcast_to(np.exp(self.vessels[vessel].log_ratio(arc, z)), (samples, len(arc)))

    def knots(self, vessel: Vessel) -> Vessel:
        """Return the vessel with additional points at the law's knots."""
        if vessel.name not in self.vessels:
            return vessel
        arc = np.union1d(vessel.arc, self.vessels[vessel.name].arc)
        arc = arc[np.r_[True, np.diff(arc) > 1e-9]]
        return replace(vessel, points=vessel.position_at(arc), radii=vessel.radius_at(arc))

    def tree(self, tree: Tree, z: Mapping[str, float]) -> Tree:
        """Return the tree with the radii of one draw."""
        one = {name: np.array([z.get(name, 0.0)]) for name in self.names}
        drawn = []
        for vessel in tree:
            fine = self.knots(vessel)
            drawn.append(replace(fine, radii=fine.radii * self.ratio(vessel.name, fine.arc, one)[0]))
        return Tree(drawn)


def lumen_law(tree: Tree, stenoses: Sequence[Stenosis], error: LumenError, modes: int = MODES) -> LumenLaw:
    """Return the law of a tree's radii.

    The correlated error has covariance exp(−d/length), d along the vessels, within each artery (LM, LAD, LCx, RCA or
    a common trunk). An artery with a stenosis gets the first `modes` terms of its Karhunen-Loève expansion in the norm
    that weighs every place, from the artery's start to `REACH` diameters behind the stenosis, by its pressure loss
    times the error's variance there. What these terms leave at a place is carried by one more coordinate of the artery,
    `lumen_ARTERY_rest`, with the standard deviation that is missing there: the law at each place is exact, and the rest
    counts as if it were wholly correlated along the artery, which overstates its effect on a resistance. It understates
    how narrow the narrowest place of a stenosis is; see `narrowest_place`.

    Parameters
    ----------
    tree
        The segmented lumen; the aorta's radii are taken as known.
    stenoses
        Stenoses placed on it.
    error
        Error of the segmentation.
    modes
        Terms per artery with a stenosis.

    Returns
    -------
    LumenLaw
        The coordinates and what they do to each vessel. Coordinates without effect are left out.

    Raises
    ------
    ValueError
        If a calcified stretch is on no coronary vessel, or outside it.
    """
    _check_calcified(tree, error)
    coronary = [_with_knots(v, 0.1 * error.length / FINENESS) for v in tree if v.branch != AORTA]
    log_sd = {v.name: _log_sd(v, stenoses, error) for v in coronary}
    columns: dict[str, dict[str, np.ndarray]] = {v.name: {COMMON: log_sd[v.name][0]} for v in coronary}
    names, captured = [COMMON], {}
    for artery in dict.fromkeys(v.branch for v in coronary):
        group = [v for v in coronary if v.branch == artery]
        weight = _pressure_loss(tree, group, [s for s in stenoses if tree[s.vessel].branch == artery])
        weight *= np.concatenate([log_sd[v.name][1] ** 2 for v in group])
        terms, share = _expansion(np.exp(-_distance(tree, group) / (0.1 * error.length)), weight, modes)
        labels = [f"{LUMEN}{artery}_{k + 1}" for k in range(len(terms))] + [f"{LUMEN}{artery}{REST}"]
        left = np.sqrt(np.clip(1.0 - (terms**2).sum(axis=0), 0.0, None))
        if len(terms):
            captured[artery] = share
        names += labels
        first = 0
        for vessel in group:
            part = slice(first, first + len(vessel.arc))
            for label, term in zip(labels, [*terms, left], strict=True):
                columns[vessel.name][label] = log_sd[vessel.name][1] * term[part]
            first = part.stop
    vessels = {}
    for vessel in coronary:
        own = {name: column for name, column in columns[vessel.name].items() if np.any(column)}
        variance = np.sum(np.square(log_sd[vessel.name]), axis=0)
        bias = error.bias * error.scale / vessel.radii
        mean = np.sign(bias) * np.log1p(np.abs(bias)) - 0.5 * variance
        vessels[vessel.name] = VesselLaw(vessel.arc, mean, own)
    used = {name for law in vessels.values() for name in law.columns}
    return LumenLaw([name for name in names if name in used], vessels, captured)


def _check_calcified(tree: Tree, error: LumenError) -> None:
    for stretch in error.calcified:
        if stretch.vessel not in tree or tree[stretch.vessel].branch == AORTA:
            known = ", ".join(v.name for v in tree if v.branch != AORTA)
            raise ValueError(f"calcified stretch on {stretch.vessel!r}: no coronary vessel; the tree has {known}")
        if stretch.end > tree[stretch.vessel].length + 1e-6:
            length = tree[stretch.vessel].length
            raise ValueError(f"calcified stretch ends at {stretch.end:.3g} of {length:.3g} cm of {stretch.vessel}")


def _with_knots(vessel: Vessel, spacing: float) -> Vessel:
    """Return the vessel with points at most `spacing` (cm) apart."""
    even = np.linspace(0.0, vessel.length, max(2, int(np.ceil(vessel.length / spacing)) + 1))
    arc = np.union1d(vessel.arc, even)
    arc = arc[np.r_[True, np.diff(arc) > 1e-9]]
    return replace(vessel, points=vessel.position_at(arc), radii=vessel.radius_at(arc))


def _log_sd(vessel: Vessel, stenoses: Sequence[Stenosis], error: LumenError) -> np.ndarray:
    """Return the standard deviation of log radius, its common and its local part, (2, n)."""
    factor = np.ones(len(vessel.arc))
    for stenosis in stenoses:
        if stenosis.vessel == vessel.name:
            inside = (vessel.arc >= stenosis.start) & (vessel.arc <= stenosis.end)
            healthy = reference_radius(vessel, stenosis.start, stenosis.end, vessel.arc)
            factor += error.narrow * np.where(inside, np.clip(1.0 - vessel.radii / healthy, 0.0, 1.0), 0.0)
    for stretch in error.calcified:
        if stretch.vessel == vessel.name:
            factor += error.calcium * ((vessel.arc >= stretch.start) & (vessel.arc <= stretch.end))
    sd = np.stack([np.full(len(factor), error.common_sd), error.local_sd * factor]) * error.scale
    total = np.sqrt((sd**2).sum(axis=0))
    if not total.any():
        return sd
    return sd / total * np.sqrt(np.log1p((total / vessel.radii) ** 2))


def _pressure_loss(tree: Tree, group: Sequence[Vessel], stenoses: Sequence[Stenosis]) -> np.ndarray:
    """Return what each knot contributes to the pressure loss on the way to and just behind the stenoses."""
    until: dict[str, float] = {}
    for stenosis in stenoses:
        vessel = tree[stenosis.vessel]
        reach = stenosis.end + 2.0 * REACH * float(vessel.radius_at(stenosis.end))
        until[vessel.name] = max(until.get(vessel.name, 0.0), min(reach, vessel.length))
        for above in tree.path(vessel.name)[:-1]:
            until[above.name] = above.length
    outlets = {v.name for v in tree.leaves()}
    parts = []
    for vessel in group:
        flow = sum(float(v.radii[-1]) ** FLOW_EXPONENT for v in tree.subtree(vessel.name) if v.name in outlets)
        spacing = np.gradient(vessel.arc) if len(vessel.arc) > 2 else np.full(len(vessel.arc), vessel.length / 2.0)
        parts.append(np.where(vessel.arc <= until.get(vessel.name, -1.0), flow * spacing * vessel.radii**-4, 0.0))
    return np.concatenate(parts)


def _distance(tree: Tree, group: Sequence[Vessel]) -> np.ndarray:
    """Return distances (n, n) cm along the vessels between all knots of a group."""
    paths = {v.name: [u.name for u in tree.path(v.name)] for v in group}
    end: dict[str, float] = {}
    for vessel in tree:
        end[vessel.name] = vessel.length + (end[vessel.parent] if vessel.parent else 0.0)
    depth = [end[v.name] - v.length + v.arc for v in group]
    rows = []
    for i, u in enumerate(group):
        row = []
        for j, v in enumerate(group):
            shared = [a for a, b in zip(paths[u.name], paths[v.name], strict=False) if a == b]
            if shared[-1] in (u.name, v.name):
                row.append(np.abs(depth[i][:, None] - depth[j]))
            else:
                fork = end[shared[-1]]
                row.append(depth[i][:, None] - fork + depth[j] - fork)
        rows.append(np.concatenate(row, axis=1))
    return np.concatenate(rows)


def _expansion(covariance: np.ndarray, weight: np.ndarray, modes: int) -> tuple[np.ndarray, float]:
    """Return the first terms (k, n) of the Karhunen-Loève expansion in a weighted norm, and their share of it."""
    inside = np.flatnonzero(weight > 0.0)
    if not len(inside):
        return np.empty((0, len(weight))), 0.0
    root = np.sqrt(weight[inside] / weight[inside].sum())
    value, vector = np.linalg.eigh(root[:, None] * covariance[np.ix_(inside, inside)] * root)
    chosen = np.argsort(value)[::-1][:modes]
    value, vector = value[chosen], vector[:, chosen]
    vector = vector * np.where(root @ vector < 0.0, -1.0, 1.0)
    terms = (covariance[:, inside] @ (root[:, None] * vector) / np.sqrt(value)).T
    return terms, float(value.sum())
