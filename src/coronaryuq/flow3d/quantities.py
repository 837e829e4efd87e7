"""Quantities of interest of a stenosis, from cycle averages on its wall region and the planes on either side."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.sparse as sp
from scipy.spatial import KDTree

from coronaryuq.core.units import MMHG
from coronaryuq.flow3d.fem.elements import face_vectors

PATCH = 0.1
"""Diameter (cm) of the patches over which wall shear and OSI are averaged."""
WHOLE_PATCH = 0.75
"""Area of a patch over that of the largest, below which the edge of the region cuts it and it is left out."""
PIECE = 0.025
"""Largest edge (cm) of the pieces of triangles that a patch consists of."""
SPACING = 0.05
"""Largest edge (cm) of the pieces of triangles that have a patch around their centroid."""


@dataclass(frozen=True)
class WallRegion:
    """Wall region of a stenosis.

    Parameters
    ----------
    rows
        (k,) rows of the region's nodes in arrays over the wall.
    area
        (k,) nodal areas, cm2.
    triangles
        (m, 3) into the region's nodes.
    size
        (m,) areas of the triangles, cm2.
    patches
        (p, k) averages over patches, as weights of nodal values.
    """

    rows: np.ndarray
    area: np.ndarray
    triangles: np.ndarray
    size: np.ndarray
    patches: sp.csr_array

    @classmethod
    def of(cls, points: np.ndarray, triangles: np.ndarray, place: np.ndarray) -> "WallRegion":
        """Return the region of triangles (m, 3) of a mesh; `place` maps mesh nodes to rows."""
        size = np.linalg.norm(face_vectors(points, triangles), axis=1)
        area = np.bincount(place[triangles].ravel(), np.repeat(size / 3.0, 3))
        rows = np.flatnonzero(area)
        local = np.searchsorted(rows, place[triangles])
        return cls(rows, area[rows], local, size, _patches(points[triangles], local, size, len(rows)))

    def share_below(self, values: np.ndarray, threshold: float) -> np.ndarray:
        """Return the fraction of the area where values (k, samples), linear on triangles, are below a threshold."""
        a, b, c = np.sort(values[self.triangles], axis=1).transpose(1, 0, 2)
        with np.errstate(invalid="ignore", divide="ignore"):
            lower = (threshold - a) ** 2 / ((b - a) * (c - a))
            upper = 1.0 - (c - threshold) ** 2 / ((c - a) * (c - b))
        below = np.where(threshold < b, np.where(threshold <= a, 0.0, lower), np.where(threshold >= c, 1.0, upper))
        return (self.size[:, None] * below).sum(axis=0) / self.size.sum()


def _patches(corners: np.ndarray, triangles: np.ndarray, size: np.ndarray, nodes: int) -> sp.csr_array:
    """Return averages over discs around centroids on the triangles; corners: (m, 3, 3), cm."""
    owner, share, area = _pieces(corners, size, PIECE)
    onto = sp.csr_array(
        (share.ravel(), (np.repeat(np.arange(len(owner)), 3), triangles[owner].ravel())), shape=(len(owner), nodes)
    )
    middle = np.einsum("qa,qac->qc", share, corners[owner])
    owner, share, _ = _pieces(corners, size, SPACING)
    centre = np.einsum("qa,qac->qc", share, corners[owner])
    near = KDTree(centre).sparse_distance_matrix(KDTree(middle), PATCH / 2.0, output_type="ndarray")
    inside = sp.csr_array((area[near["j"]], (near["i"], near["j"])), shape=(len(centre), len(middle)))
    total = inside.sum(axis=1)
    whole = total >= WHOLE_PATCH * total.max()
    averages = sp.csr_array(sp.diags_array(1.0 / total[whole]) @ inside[whole] @ onto)
    averages.sort_indices()
    return averages


def _pieces(corners: np.ndarray, size: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut triangles into equal pieces; return the pieces' triangle, barycentric centroid (q, 3) and area, cm2."""
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    cuts = np.maximum(1, np.ceil(edge / longest)).astype(int)
    owner = np.repeat(np.arange(len(cuts)), cuts**2)
    return owner, np.concatenate([_centroids(count) for count in cuts.tolist()]), (size / cuts**2)[owner]


@cache
def _centroids(cuts: int) -> np.ndarray:
    """Return barycentric coordinates (cuts², 3) of the centroids of a triangle's equal pieces."""
    i, j = np.meshgrid(np.arange(cuts), np.arange(cuts), indexing="ij")
    upright = (i + j) < cuts
    turned = (i + j) < cuts - 1
    first = np.concatenate([i[upright] + 1 / 3, i[turned] + 2 / 3]) / cuts
    second = np.concatenate([j[upright] + 1 / 3, j[turned] + 2 / 3]) / cuts
    return np.stack([first, second, 1.0 - first - second], axis=1)


def stenosis_quantities(
    stenosis: str,
    distal: np.ndarray,
    aortic: np.ndarray,
    tawss: np.ndarray,
    osi: np.ndarray,
    region: WallRegion,
    low_shear: float,
    proximal: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Return FFR, pressure drop and the statistics of wall shear of one stenosis, by their names in the records.

    Each is (samples,). The drop, mmHg, is that from the plane before the stenosis to the one of FFR behind it.

    Parameters
    ----------
    stenosis
        Its name.
    distal, aortic
        (samples,) mean pressure on the distal plane and in the aorta, dyn/cm2.
    tawss, osi
        (k, samples) time-averaged wall shear stress (dyn/cm2) and oscillatory shear index on the region's nodes.
    region
        The region.
    low_shear
        Wall shear stress below which it counts as low, dyn/cm2.
    proximal
        (samples,) mean pressure on the plane before it, dyn/cm2; None where the mesh has no such plane.
    """
    key, area = stenosis.lower(), region.area
    weight = area[:, None]
    drop = {} if proximal is None else {f"pressure_drop_{key}": (proximal - distal) / MMHG}
    return {
        f"ffr_{key}": distal / aortic,
        f"tawss_min_{key}": tawss.min(axis=0),
        f"osi_max_{key}": osi.max(axis=0),
        f"tawss_q01_{key}": area_quantile(tawss, area, 0.01),
        f"osi_q99_{key}": area_quantile(osi, area, 0.99),
        f"tawss_mean_{key}": (weight * tawss).sum(axis=0) / area.sum(),
        f"osi_mean_{key}": (weight * osi).sum(axis=0) / area.sum(),
        f"tawss_patch_min_{key}": (region.patches @ tawss).min(axis=0),
        f"osi_patch_max_{key}": (region.patches @ osi).max(axis=0),
        f"low_shear_area_{key}": region.share_below(tawss, low_shear),
        f"distal_pressure_{key}": distal,
        **drop,
    }


def area_quantile(values: np.ndarray, area: np.ndarray, share: float) -> np.ndarray:
    """Return the value below which `share` of the area lies: values (k, samples), area (k,) → (samples,).

    Linear between the midpoints of the nodes' fractions of the cumulative area.
    """
    out = np.empty(values.shape[1])
    for s in range(values.shape[1]):
        order = np.argsort(values[:, s], kind="stable")
        weight = area[order]
        middle = (np.cumsum(weight) - 0.5 * weight) / weight.sum()
        out[s] = np.interp(share, middle, values[order, s])
    return out
