"""Vessels of synthetic patients: a coronary tree on an ellipsoidal heart, drawn from a seed.

Courses follow the grooves and walls that the arteries are named after. Calibres follow the flow of a vessel, r ~
Q^(1/k) with k = 2.7 at bifurcations (Murray 1926; Kassab 2007 measured 2.3 to 2.7 in coronary trees), where the flow of
an outlet is in proportion to the left ventricular wall nearest to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from coronaryuq.case.anatomy.tree import AORTA, Stenosis, Tree, Vessel
from coronaryuq.core import seeds
from coronaryuq.synthetic.arteries import BUNDLED, PATTERNS, Artery, Lesion, Pattern
from coronaryuq.synthetic.ventricle import Ventricle

SEED = 2024
"""Seed of the bundled patient."""
EXPONENT = 2.7
"""Exponent k of Murray's law, r_parent^k = Σ r_child^k."""
CLEAR = 0.1
"""cm between a stenosis and the next bifurcation, at least."""
TAPER = 0.93
"""End radius over start radius of a vessel between bifurcations; outlets taper more, see OUTLET_TAPER."""
OUTLET_TAPER = 0.85
SMALLEST = 0.07
"""cm: smallest initial radius unless the parent is narrower; CT angiography resolves little below this."""
SPACING = 0.05
"""cm between centreline points."""

AORTIC_AXIS = np.array([-0.30, -0.05, 0.95]) / np.linalg.norm([-0.30, -0.05, 0.95])
ANNULUS = np.array([-1.34, -1.12, 0.2])
OSTIAL_LEVEL, AORTIC_LENGTH = 1.5, 4.5
"""cm above the annulus."""
AORTIC_RADII = ([0.0, 0.9, 1.5, 2.2, 4.5], [1.20, 1.50, 1.55, 1.35, 1.45])
"""cm above the annulus, and cm: annulus, sinuses, sinotubular junction, ascending aorta."""


def _body_axes() -> np.ndarray:
    """Return as columns the heart frame's x, y and z in left-posterior-superior body axes."""
    base = np.array([-0.60, 0.53, 0.60])
    base /= np.linalg.norm(base)
    lateral = np.array([0.6, 0.8, 0.1])
    lateral -= (lateral @ base) * base
    lateral /= np.linalg.norm(lateral)
    return np.stack([lateral, np.cross(base, lateral), base], axis=1)


HEART_TO_PATIENT = _body_axes()
"""The apex points left, forwards and down; the lateral wall left and backwards; the anterior wall forwards and up."""


@dataclass(frozen=True)
class Outlet:
    """A coronary outlet: its vessel and label, the tissue that it perfuses (LV, RV or septum), and its branch."""

    vessel: str
    label: str
    perfuses: str
    branch: str


@dataclass(frozen=True)
class Anatomy:
    """The bundled patient's vessels, in body axes (cm), and the heart, in its own frame."""

    tree: Tree
    outlets: tuple[Outlet, ...]
    stenoses: tuple[Stenosis, ...]
    ventricle: Ventricle

    @staticmethod
    def to_heart_frame(points: np.ndarray) -> np.ndarray:
        """Rotate points (..., 3), cm, from body axes to the heart frame."""
        return points @ HEART_TO_PATIENT

    @staticmethod
    def to_body_axes(points: np.ndarray) -> np.ndarray:
        """Rotate points (..., 3), cm, from the heart frame to body axes."""
        return points @ HEART_TO_PATIENT.T

    def wall(self, cells: int = 30_000):
        """Mesh the left ventricular wall with about `cells` tetrahedra, in body axes, cm."""
        mesh = self.ventricle.mesh(cells)
        mesh.points = self.to_body_axes(np.asarray(mesh.points))
        return mesh


def patient_anatomy(seed: int = SEED, dominance: str = "right", lesions: Sequence[Lesion] = BUNDLED) -> Anatomy:
    """Draw an anatomy; by default the bundled patient's.

    Another seed moves the courses by degrees and millimetres, which gives another patient of this kind.

    Raises
    ------
    ValueError
        If a stenosis fits nowhere on its artery.
    """
    pattern, ventricle = PATTERNS[dominance], Ventricle()
    courses = _courses(ventricle, pattern.arteries, seeds.generator(seed, "patient", "anatomy"))
    pieces = _pieces(courses)
    shares = _shares(ventricle, courses)
    tree, names = _tree(pattern, courses, pieces, shares)
    ends = {p.artery: names[p.artery, p.number] for p in pieces}
    outlets = tuple(Outlet(ends[a.name], a.name, a.perfuses, a.branch) for a in pattern.arteries)
    stenoses = tuple(_stenosis(courses, pieces, names, lesion) for lesion in lesions)
    for stenosis, lesion in zip(stenoses, lesions, strict=True):
        tree = tree.with_vessels({stenosis.vessel: narrowed(tree[stenosis.vessel], stenosis, lesion.reduction)})
    in_body_axes = [replace(v, points=Anatomy.to_body_axes(v.points)) for v in tree]
    return Anatomy(Tree(in_body_axes), outlets, stenoses, ventricle)


def narrowed(vessel: Vessel, stenosis: Stenosis, reduction: float) -> Vessel:
    """Add a cosine-shaped narrowing that reduces the vessel's diameter at the throat by the fraction `reduction`."""
    arc = np.union1d(vessel.arc, np.linspace(stenosis.start, stenosis.end, 41))
    arc = arc[np.concatenate([[True], np.diff(arc) > 1e-6])]
    middle, length = (stenosis.start + stenosis.end) / 2, stenosis.end - stenosis.start
    shape = np.where(np.abs(arc - middle) < length / 2, (1 + np.cos(2 * np.pi * (arc - middle) / length)) / 2, 0.0)
    return replace(vessel, points=vessel.position_at(arc), radii=vessel.radius_at(arc) * (1 - reduction * shape))


@dataclass(frozen=True)
class _Course:
    """An artery's curve: dense points in the heart frame, and the arc length at each control point (`knots`)."""

    artery: Artery
    points: np.ndarray
    arc: np.ndarray
    knots: np.ndarray

    def arc_of(self, index: float) -> float:
        """Return the arc length at a fractional index of the control points: 1.5 is half-way from 1 to 2."""
        return float(np.interp(index, np.arange(len(self.knots)), self.knots))

    def position_at(self, arc) -> np.ndarray:
        return np.stack([np.interp(arc, self.arc, self.points[:, k]) for k in range(3)], axis=-1)


def _courses(ventricle: Ventricle, arteries: Sequence[Artery], random: np.random.Generator) -> dict[str, _Course]:
    courses: dict[str, _Course] = {}
    for artery in arteries:
        phi, s, depth = np.array(artery.course).T
        # One shift per artery and a smaller one per control point: arteries vary as a whole, without kinks.
        phi = phi + random.normal(0, 1.0) + random.normal(0, 0.6, len(phi))
        s = s + np.where(s > 0.1, random.normal(0, 0.008) + random.normal(0, 0.004, len(s)), 0.0)
        on_heart = ventricle.epicardium(np.radians(phi), s)
        lifted = on_heart + 0.2 * _outward(ventricle, np.radians(phi), s)
        in_wall = ventricle.point(np.radians(phi), s, depth)
        control = np.where(depth[:, None] > 0, in_wall, lifted)
        if artery.origin == AORTA:
            level = ANNULUS + OSTIAL_LEVEL * AORTIC_AXIS
            toward = control[0] - level
            toward = toward - 0.8 * (toward @ AORTIC_AXIS) * AORTIC_AXIS
            toward /= np.linalg.norm(toward)
            lead = np.array([level, level + 1.1 * toward, level + 1.9 * toward])
        else:
            origin = courses[artery.origin]
            lead = origin.position_at(origin.arc_of(artery.origin_point))[None]
        through = np.concatenate([lead, control])
        chord = np.concatenate([[0], np.cumsum(np.sqrt(np.linalg.norm(np.diff(through, axis=0), axis=1)))])
        dense = CubicSpline(chord, through)(np.linspace(0, chord[-1], 4000))
        arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))])
        knots = np.interp(chord[len(lead) :], np.linspace(0, chord[-1], 4000), arc)
        courses[artery.name] = _Course(artery, dense, arc, knots)
    return courses


def _outward(ventricle: Ventricle, phi: np.ndarray, s: np.ndarray, step: float = 1e-4) -> np.ndarray:
    """Compute unit outward normals (n, 3) of the epicardial surface."""
    by_phi = ventricle.epicardium(phi + step, s) - ventricle.epicardium(phi - step, s)
    by_s = ventricle.epicardium(phi, s + step) - ventricle.epicardium(phi, s - step)
    normal = np.cross(by_phi, by_s)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


@dataclass(frozen=True)
class _Piece:
    """Part of an artery between two bifurcations: number along the artery, arc lengths, the piece that feeds it."""

    artery: str
    number: int
    start: float
    end: float
    parent: tuple[str, int] | None


def _pieces(courses: dict[str, _Course]) -> list[_Piece]:
    pieces: list[_Piece] = []
    for name, course in courses.items():
        cuts = sorted(course.arc_of(c.artery.origin_point) for c in courses.values() if c.artery.origin == name)
        ends = [*cuts, course.arc[-1]]
        for number, end in enumerate(ends):
            if number > 0:
                parent = (name, number - 1)
            elif course.artery.origin == AORTA:
                parent = None
            else:
                origin_arc = courses[course.artery.origin].arc_of(course.artery.origin_point)
                parent = next(
                    (p.artery, p.number) for p in pieces if p.artery == course.artery.origin and p.end >= origin_arc
                )
            pieces.append(_Piece(name, number, 0.0 if number == 0 else ends[number - 1], end, parent))
    return pieces


def _shares(ventricle: Ventricle, courses: dict[str, _Course]) -> dict[str, float]:
    """Return each artery's fraction of coronary flow: that of the wall nearest to its end, or the one stated."""
    feeding = [c for c in courses.values() if c.artery.perfuses == "LV"]
    wall = ventricle.mesh(12_000)
    volumes = np.asarray(wall.compute_cell_sizes(length=False, area=False)["Volume"])
    _, nearest = cKDTree([c.points[-1] for c in feeding]).query(np.asarray(wall.cell_centers().points, dtype=float))
    territory = np.bincount(nearest, weights=volumes, minlength=len(feeding)) / volumes.sum()
    stated = {c.artery.name: c.artery.share for c in courses.values() if c.artery.share}
    remaining = 1.0 - sum(stated.values())
    return stated | {c.artery.name: remaining * float(t) for c, t in zip(feeding, territory, strict=True)}


def _tree(
    pattern: Pattern, courses: dict[str, _Course], pieces: list[_Piece], shares: dict[str, float]
) -> tuple[Tree, dict[tuple[str, int], str]]:
    """Make vessels with calibres, named as in published models: branchN inside, lcaN and rcaN at the ends."""
    key = {(p.artery, p.number): p for p in pieces}
    last = {name: max(p.number for p in pieces if p.artery == name) for name in courses}
    flow = {
        k: sum(shares[a] for a in courses if _passes(key, k, (a, last[a])))
        for k in key
    }  # fmt: skip
    names: dict[tuple[str, int], str] = {}
    ends = {"l": 0, "r": 0}
    vessels = [_aorta("aorta", 0.0, OSTIAL_LEVEL, None)]
    end_radius: dict[tuple[str, int], float] = {}
    for k, piece in key.items():
        course, artery = courses[piece.artery], courses[piece.artery].artery
        if k == (piece.artery, last[piece.artery]):
            side, taper = "r" if artery.branch == "RCA" else "l", OUTLET_TAPER
            ends[side] += 1
            names[k] = f"{side}ca{ends[side]}"
        else:
            names[k], taper = f"branch{len(vessels)}", TAPER
        if piece.parent is None:
            start = pattern.right_ostium if artery.branch == "RCA" else pattern.left_main
        else:
            parent_radius = end_radius[piece.parent]
            share = flow[k] / flow[piece.parent]
            start = max(parent_radius * share ** (1 / EXPONENT), min(SMALLEST, parent_radius))
        end_radius[k] = start * taper
        arc = np.linspace(piece.start, piece.end, max(3, int(np.ceil((piece.end - piece.start) / SPACING)) + 1))
        vessels.append(
            Vessel(
                names[k],
                course.position_at(arc),
                np.linspace(start, end_radius[k], len(arc)),
                "aorta" if piece.parent is None else names[piece.parent],
                "LM" if k == ("LAD", 0) else artery.branch,
            )
        )
    vessels.append(_aorta("aorta_outlet", OSTIAL_LEVEL, AORTIC_LENGTH, "aorta"))
    return Tree(vessels), names


def _passes(key: dict[tuple[str, int], _Piece], through: tuple[str, int], end: tuple[str, int]) -> bool:
    """Return whether blood on its way to the piece `end` passes through the piece `through`."""
    here: tuple[str, int] | None = end
    while here is not None and here != through:
        here = key[here].parent
    return here is not None


def _aorta(name: str, low: float, high: float, parent: str | None) -> Vessel:
    height = np.linspace(low, high, int(np.ceil((high - low) / 0.1)) + 1)
    return Vessel(name, ANNULUS + height[:, None] * AORTIC_AXIS, np.interp(height, *AORTIC_RADII), parent, AORTA)


def _stenosis(courses: dict[str, _Course], pieces: list[_Piece], names, lesion: Lesion) -> Stenosis:
    course = courses[lesion.artery]
    wanted, half, places = course.arc_of(lesion.at), lesion.length / 2, []
    for piece in pieces:
        low, high = max(piece.start, course.knots[0]) + CLEAR + half, piece.end - CLEAR - half
        if piece.artery == lesion.artery and low <= high:
            arc = min(max(wanted, low), high)
            places.append((abs(arc - wanted), arc, piece))
    if not places:
        raise ValueError(f"the stenosis of {lesion.name} does not fit between two bifurcations")
    _, arc, piece = min(places, key=lambda place: place[:2])
    start = arc - piece.start - half
    return Stenosis(lesion.name, names[lesion.artery, piece.number], start, start + lesion.length)
