"""Groups of arrays that kernels take together."""

from typing import NamedTuple

import numpy as np


class Elements(NamedTuple):
    """Tetrahedra: nodes (m, 4); hat gradients (m, 4, 3) in 1/cm and volumes (m,) in cm3 as `rows`, see `fem.lanes`."""

    tets: np.ndarray
    grad: np.ndarray
    volume: np.ndarray


class Pattern(NamedTuple):
    """Pattern of the mesh's sparse matrices: row starts (n + 1,), columns (nnz,), diagonal entries (n,)."""

    start: np.ndarray
    column: np.ndarray
    diagonal: np.ndarray


class Motion(NamedTuple):
    """How nodes may move: free (n,) if the velocity is unknown, free_nodes (k,), cap (n,) or -1, cap normals (·, 3).

    On a cap only the velocity along its normal is unknown.
    """

    free: np.ndarray
    free_nodes: np.ndarray
    cap: np.ndarray
    normal: np.ndarray
