"""SimVascular projects of straight vessels, written as SimVascular writes them."""

from pathlib import Path

import numpy as np

HEAD = '<?xml version="1.0" encoding="UTF-8" ?>\n<format version="1.0" />\n'


def write_path(folder: Path, name: str, start, end, times: int = 1) -> None:
    """Write a path of two control points; of several time steps, later ones lie elsewhere."""
    (folder / "Paths").mkdir(parents=True, exist_ok=True)
    steps = [
        f'<timestep id="{k}"><path_element><control_points>{_points((np.array(start) + k, np.array(end) + k))}'
        "</control_points></path_element></timestep>"
        for k in range(times)
    ]
    (folder / "Paths" / f"{name}.pth").write_text(f'{HEAD}<path id="1">{"".join(steps)}</path>\n')


def write_contours(
    folder: Path, name: str, start, end, radius: float, path: str | None = None, times: int = 1, places=(0, 1, 2, 3, 4)
) -> None:
    """Write circles along a line, of the path `path`; of several time steps, later ones are twice as wide."""
    (folder / "Segmentations").mkdir(parents=True, exist_ok=True)
    start, end = np.array(start, dtype=float), np.array(end, dtype=float)
    across = np.linalg.svd((end - start)[None])[2][1:]
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.cos(angle)[:, None] * across[0] + np.sin(angle)[:, None] * across[1]
    centres = [start + (end - start) * place / max(places) for place in places]
    steps = []
    for k in range(times):
        contours = [
            f'<contour id="{n}"><path_point id="{place}"><pos x="0" y="0" z="0"/></path_point><contour_points>'
            f"{_points(centre + radius * (k + 1) * ring)}</contour_points></contour>"
            for n, (place, centre) in enumerate(zip(places, centres, strict=True))
        ]
        steps.append(f'<timestep id="{k}">{"".join(contours)}</timestep>')
    text = f'{HEAD}<contourgroup path_name="{path or name}" path_id="1">{"".join(steps)}</contourgroup>\n'
    (folder / "Segmentations" / f"{name}.ctgr").write_text(text)


def write_vessel(folder: Path, name: str, start, end, radius: float, **more) -> None:
    """Write a path and its contours."""
    write_path(folder, name, start, end)
    write_contours(folder, name, start, end, radius, **more)


def _points(points) -> str:
    rows = np.asarray(points, dtype=float).tolist()
    return "".join(f'<point id="{k}" x="{x!r}" y="{y!r}" z="{z!r}" />' for k, (x, y, z) in enumerate(rows))
