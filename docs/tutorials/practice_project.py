"""Write a small SimVascular project to practise on: python practice_project.py FOLDER.

Six arteries of simple shape, lengths in mm. The left anterior descending artery (LAD) has a stenosis.
"""

import sys
from pathlib import Path

import numpy as np

ARTERIES = {
    # name: control points (mm), radius at start and end (mm), where its contours begin (share of its length)
    "aorta": ([(0, 0, -20), (0, 0, 0), (0, 0, 20), (0, 0, 50)], (12.0, 11.0), 0.0),
    "LAD": ([(0, 0, 0), (20, 0, 2), (32, -4, 0), (48, -14, -14), (60, -22, -34)], (1.9, 1.1), 0.24),
    "LCx": ([(26, -2, 1), (33, 9, -4), (38, 22, -14), (38, 36, -28)], (1.6, 1.1), 0.12),
    "D1": ([(44, -11, -10), (56, -5, -18), (70, 2, -30)], (1.2, 0.9), 0.15),
    "RCA": ([(0, 0, 6), (-20, 2, 6), (-34, 8, -8), (-42, 14, -30), (-40, 22, -52)], (1.8, 1.3), 0.22),
    "RV1": ([(-38, 11, -17), (-50, 2, -24), (-60, -8, -34)], (1.1, 0.9), 0.15),
}
STENOSIS = ("LAD", 0.54, 0.07, 0.45)
"""Artery, place and half-length (shares of its length), and the share of its radius that is lost."""


def curve(control: list) -> np.ndarray:
    """Return points (200, 3) on a smooth line through the control points (Catmull-Rom)."""
    knots = np.array([control[0], *control, control[-1]], dtype=float)
    pieces = []
    for a, b, c, d in zip(knots, knots[1:], knots[2:], knots[3:], strict=False):
        t = np.linspace(0, 1, 200 // (len(control) - 1), endpoint=False)[:, None]
        pieces.append(0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3))
    return np.vstack([*pieces, knots[-1:]])


def radius(name: str, share: float) -> float:
    """Return the radius (mm) at a share of an artery's length."""
    first, last = ARTERIES[name][1]
    stenosed, place, half, lost = STENOSIS
    value = first + (last - first) * share
    if name == stenosed and abs(share - place) < half:
        value *= 1 - lost * (1 + np.cos(np.pi * (share - place) / half)) / 2
    return value


def point(number: int, xyz: np.ndarray) -> str:
    x, y, z = xyz
    return f'<point id="{number}" x="{x:.6f}" y="{y:.6f}" z="{z:.6f}" />'


def write_artery(folder: Path, number: int, name: str) -> None:
    """Write the path (.pth) and the contour group (.ctgr) of one artery."""
    control, _, begin = ARTERIES[name]
    points = curve(control)
    head = '<?xml version="1.0" encoding="UTF-8" ?>\n<format version="1.0" />\n'
    control_points = "".join(point(k, xyz) for k, xyz in enumerate(np.array(control, dtype=float)))
    (folder / "Paths" / f"{name}.pth").write_text(
        f'{head}<path id="{number}" method="0" calculation_number="{len(points)}"><timestep id="0"><path_element>'
        f"<control_points>{control_points}</control_points></path_element></timestep></path>\n"
    )
    angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)[:, None]
    contours = []
    for k, share in enumerate(np.linspace(begin, 1, 41)):
        at = round(share * (len(points) - 1))
        tangent = points[min(at + 1, len(points) - 1)] - points[max(at - 1, 0)]
        tangent /= np.linalg.norm(tangent)
        across = np.cross(tangent, np.eye(3)[np.argmin(np.abs(tangent))])
        across /= np.linalg.norm(across)
        rim = points[at] + radius(name, share) * (np.cos(angles) * across + np.sin(angles) * np.cross(tangent, across))
        rim_points = "".join(point(j, xyz) for j, xyz in enumerate(rim))
        contours.append(
            f'<contour id="{k}" type="Circle" method="Manual" closed="true"><path_point id="{at}" />'
            f"<contour_points>{rim_points}</contour_points></contour>"
        )
    (folder / "Segmentations" / f"{name}.ctgr").write_text(
        f'{head}<contourgroup path_name="{name}" path_id="{number}"><timestep id="0">{"".join(contours)}</timestep>'
        "</contourgroup>\n"
    )


if __name__ == "__main__":
    target = Path(sys.argv[1])
    for part in ("Paths", "Segmentations"):
        (target / part).mkdir(parents=True, exist_ok=True)
    for number, name in enumerate(ARTERIES, start=1):
        write_artery(target, number, name)
