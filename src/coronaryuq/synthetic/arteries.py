"""Patterns of the coronary arteries: courses on the heart, right- and left-dominant, and where stenoses lie on them."""

from dataclasses import dataclass, replace

from coronaryuq.case.anatomy.tree import AORTA


@dataclass(frozen=True)
class Artery:
    """An artery as anatomists draw it, from its origin to its end, without its side branches.

    course: control points (φ in degrees, s, depth); depth 0 is the epicardium, a positive one inside the left
    ventricular wall. origin: name of the artery from which it branches. origin_point: place of the branching, as a
    fractional index of the origin's control points. share: fraction of the coronary flow; 0 if it follows from the left
    ventricular territory.
    """

    name: str
    branch: str
    perfuses: str
    origin: str
    origin_point: float
    course: tuple[tuple[float, float, float], ...]
    share: float = 0.0


RIGHT = (
    Artery("LAD", "LAD", "LV", AORTA, 0, (
        (108, 0.00, 0), (117, 0.10, 0), (120, 0.22, 0), (121, 0.36, 0), (120, 0.48, 0), (120, 0.57, 0), (122, 0.64, 0),
        (127, 0.72, 0))),
    Artery("LCx", "LCx", "LV", "LAD", 0.0, (
        (92, -0.015, 0), (76, 0.00, 0), (56, 0.01, 0), (36, 0.015, 0), (16, 0.02, 0), (-6, 0.03, 0), (-24, 0.06, 0),
        (-38, 0.09, 0), (-46, 0.14, 0))),
    Artery("D1", "LAD", "LV", "LAD", 1.6, (
        (108, 0.20, 0), (100, 0.24, 0), (94, 0.29, 0), (90, 0.34, 0), (88, 0.40, 0))),
    Artery("D1b", "LAD", "LV", "D1", 0.5, ((96, 0.20, 0), (86, 0.23, 0), (76, 0.29, 0), (69, 0.36, 0))),
    Artery("S1", "LAD", "septum", "LAD", 2.1, ((130, 0.27, 0.25), (142, 0.33, 0.42), (156, 0.40, 0.45)), 0.04),
    Artery("D2", "LAD", "LV", "LAD", 3.0, ((109, 0.40, 0), (101, 0.46, 0), (95, 0.52, 0), (89, 0.57, 0))),
    Artery("S2", "LAD", "septum", "LAD", 3.7, ((131, 0.51, 0.25), (145, 0.57, 0.42), (158, 0.63, 0.45)), 0.03),
    Artery("D3", "LAD", "LV", "LAD", 4.9, ((108, 0.595, 0), (90, 0.64, 0), (68, 0.68, 0))),
    Artery("OM1", "LCx", "LV", "LCx", 2.15, (
        (48, 0.10, 0), (44, 0.19, 0), (42, 0.26, 0), (41, 0.33, 0), (41, 0.40, 0))),
    Artery("OM2", "LCx", "LV", "LCx", 3.9, ((13, 0.10, 0), (10, 0.19, 0), (14, 0.24, 0), (20, 0.29, 0))),
    Artery("OM2b", "LCx", "LV", "OM2", 0.6, ((3, 0.21, 0), (-4, 0.32, 0), (-3, 0.45, 0), (1, 0.57, 0))),
    Artery("OM3", "LCx", "LV", "LCx", 5.3, ((-15, 0.14, 0), (-18, 0.22, 0), (-21, 0.31, 0), (-24, 0.41, 0))),
    Artery("PDA", "RCA", "LV", AORTA, 0, (
        (149, -0.02, 0), (163, -0.01, 0), (178, 0.00, 0), (193, 0.01, 0), (207, 0.01, 0),
        (220, 0.02, 0), (232, 0.03, 0), (240, 0.08, 0), (242, 0.18, 0), (241, 0.29, 0), (240, 0.38, 0), (239, 0.46, 0),
        (237, 0.53, 0))),
    Artery("conus", "RCA", "RV", "PDA", 0.5, ((149, 0.12, 0), (145, 0.22, 0), (141, 0.32, 0)), 0.03),
    Artery("RV", "RCA", "RV", "PDA", 1.7, ((168, 0.12, 0), (163, 0.25, 0), (158, 0.38, 0)), 0.04),
    Artery("AM", "RCA", "RV", "PDA", 4.0, ((202, 0.12, 0), (196, 0.25, 0), (190, 0.38, 0), (186, 0.50, 0)), 0.06),
    Artery("PL", "RCA", "LV", "PDA", 6.6, (
        (248, 0.04, 0), (260, 0.06, 0), (272, 0.09, 0), (281, 0.16, 0), (287, 0.22, 0),
        (290, 0.28, 0), (292, 0.35, 0))),
    Artery("PL1", "RCA", "LV", "PL", 0.6, ((255, 0.14, 0), (257, 0.20, 0), (257, 0.26, 0), (256, 0.31, 0))),
    Artery("PL2", "RCA", "LV", "PL", 3.9, ((280, 0.26, 0), (275, 0.37, 0), (274, 0.48, 0), (275, 0.59, 0))),
)  # fmt: skip
"""Before random shifts. The right coronary artery is one course that ends as the PDA."""


def _left_dominant() -> tuple[Artery, ...]:
    """Return the courses in which the circumflex reaches the crux and ends as the PDA; the right artery ends early."""
    circumflex = (
        (92, -0.015, 0), (76, 0.00, 0), (56, 0.01, 0), (36, 0.015, 0), (16, 0.02, 0), (-6, 0.03, 0), (-26, 0.03, 0),
        (-46, 0.025, 0), (-66, 0.02, 0), (-86, 0.02, 0), (-104, 0.03, 0), (-117, 0.08, 0), (-118, 0.18, 0),
        (-119, 0.29, 0), (-120, 0.38, 0), (-121, 0.46, 0), (-123, 0.53, 0),
    )  # fmt: skip
    by_name = {artery.name: artery for artery in RIGHT}
    marginal = by_name["AM"]
    right = replace(
        marginal, name="RCA", origin=AORTA, origin_point=0.0, course=(*by_name["PDA"].course[:4], *marginal.course)
    )
    posterolateral = (
        Artery("PL1", "LCx", "LV", "LCx", 7.3, (
            (-55, 0.10, 0), (-58, 0.18, 0), (-61, 0.26, 0), (-63, 0.35, 0), (-64, 0.44, 0))),
        Artery("PL2", "LCx", "LV", "LCx", 9.0, (
            (-91, 0.10, 0), (-92, 0.20, 0), (-91, 0.30, 0), (-90, 0.40, 0), (-89, 0.50, 0))),
    )  # fmt: skip
    from_left = [artery for artery in RIGHT if artery.branch != "RCA"]
    left = [replace(artery, course=circumflex) if artery.name == "LCx" else artery for artery in from_left]
    from_right = [replace(by_name[name], origin="RCA") for name in ("conus", "RV")]
    return (*left, *posterolateral, right, *from_right)


@dataclass(frozen=True)
class Pattern:
    """Arteries, parents first, and the radii (cm) with which the left main and the right coronary artery begin.

    right: name of the right coronary artery's course.
    """

    arteries: tuple[Artery, ...]
    left_main: float
    right_ostium: float
    right: str


PATTERNS = {
    "right": Pattern(RIGHT, 0.215, 0.19, "PDA"),
    "left": Pattern(_left_dominant(), 0.23, 0.14, "RCA"),
}
"""By dominance. Diameters in CT and angiography: left main 4.0 to 4.6 mm, right coronary artery 3.5 to 4.0 mm, 2.8 mm
where the left dominates (Dodge et al. 1992)."""


@dataclass(frozen=True)
class Lesion:
    """A stenosis to make: its name, the artery, a fractional index of its control points, length (cm), severity.

    reduction: of the diameter at the throat. One that does not fit between two bifurcations is moved to the nearest
    place where it does.
    """

    name: str
    artery: str
    at: float
    length: float
    reduction: float


BUNDLED = (
    Lesion("LAD", "LAD", 0.85, 1.2, 0.60),
    Lesion("LCx", "LCx", 0.9, 1.0, 0.60),
    Lesion("RCA", "PDA", 2.9, 1.4, 0.60),
)
"""Of the bundled patient."""
