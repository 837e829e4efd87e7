"""Quantities of interest of a stenosis, from cycle averages on its wall region and its distal plane."""

import numpy as np

from coronaryuq.flow3d.fem.elements import face_vectors


def nodal_area(points: np.ndarray, triangles: np.ndarray, place: np.ndarray, nodes: int) -> np.ndarray:
    """Return each node's third of the triangles around it (nodes,), cm2; `place` maps mesh nodes to rows."""
    size = np.linalg.norm(face_vectors(points, triangles), axis=1)
    return np.bincount(place[triangles].ravel(), np.repeat(size / 3.0, 3), nodes)


def stenosis_quantities(
    stenosis: str, distal: np.ndarray, aortic: np.ndarray, tawss: np.ndarray, osi: np.ndarray, area: np.ndarray
) -> dict[str, np.ndarray]:
    """Return FFR and the statistics of wall shear of one stenosis, each (samples,), by their names in the records.

    Parameters
    ----------
    stenosis
        Its name.
    distal, aortic
        (samples,) mean pressure on the distal plane and in the aorta, dyn/cm2.
    tawss, osi
        (k, samples) time-averaged wall shear stress (dyn/cm2) and oscillatory shear index on the region's nodes.
    area
        (k,) nodal areas, cm2.
    """
    key, weight = stenosis.lower(), area[:, None]
    return {
        f"ffr_{key}": distal / aortic,
        f"tawss_min_{key}": tawss.min(axis=0),
        f"osi_max_{key}": osi.max(axis=0),
        f"tawss_q01_{key}": area_quantile(tawss, area, 0.01),
        f"osi_q99_{key}": area_quantile(osi, area, 0.99),
        f"tawss_mean_{key}": (weight * tawss).sum(axis=0) / area.sum(),
        f"osi_mean_{key}": (weight * osi).sum(axis=0) / area.sum(),
        f"distal_pressure_{key}": distal,
    }


def area_quantile(values: np.ndarray, area: np.ndarray, share: float) -> np.ndarray:
    """Return the value below which `share` of the area lies: values (k, samples), area (k,) → (samples,).

    Linear between the midpoints of the nodes' shares of the cumulative area.
    """
    out = np.empty(values.shape[1])
    for s in range(values.shape[1]):
        order = np.argsort(values[:, s], kind="stable")
        weight = area[order]
        middle = (np.cumsum(weight) - 0.5 * weight) / weight.sum()
        out[s] = np.interp(share, middle, values[order, s])
    return out
