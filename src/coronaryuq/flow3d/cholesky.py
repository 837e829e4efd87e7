"""One sparse factor for every sample: Cholesky by SuperLU, triangular solves with the sample index innermost."""

import numba as nb
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from coronaryuq.flow3d.lanes import LANES


@nb.njit(cache=True, error_model="numpy")
def _solve(order, low_start, low_row, low_value, up_start, up_row, up_value, diagonal, b, x):
    n = order.shape[0]
    for i in range(n):
        source = order[i]
        for s in range(LANES):
            x[i, s] = b[source, s]
        k, end = low_start[i], low_start[i + 1]
        while k + 4 <= end:
            j0, j1, j2, j3 = low_row[k], low_row[k + 1], low_row[k + 2], low_row[k + 3]
            v0, v1, v2, v3 = low_value[k], low_value[k + 1], low_value[k + 2], low_value[k + 3]
            for s in range(LANES):
                x[i, s] -= (v0 * x[j0, s] + v1 * x[j1, s]) + (v2 * x[j2, s] + v3 * x[j3, s])
            k += 4
        while k < end:
            j0, v0 = low_row[k], low_value[k]
            for s in range(LANES):
                x[i, s] -= v0 * x[j0, s]
            k += 1
    for i in range(n - 1, -1, -1):
        d = diagonal[i]
        for s in range(LANES):
            x[i, s] *= d
        k, end = up_start[i], up_start[i + 1]
        while k + 4 <= end:
            j0, j1, j2, j3 = up_row[k], up_row[k + 1], up_row[k + 2], up_row[k + 3]
            v0, v1, v2, v3 = up_value[k], up_value[k + 1], up_value[k + 2], up_value[k + 3]
            for s in range(LANES):
                x[i, s] -= (v0 * x[j0, s] + v1 * x[j1, s]) + (v2 * x[j2, s] + v3 * x[j3, s])
            k += 4
        while k < end:
            j0, v0 = up_row[k], up_value[k]
            for s in range(LANES):
                x[i, s] -= v0 * x[j0, s]
            k += 1
        target = order[i]
        for s in range(LANES):
            b[target, s] = x[i, s]


class Cholesky:
    """LDLᵀ of a symmetric positive definite matrix (n, n), factored once and used by every sample and step.

    The triangular solves are written out, because the ones in libraries may round differently for another number of
    right-hand sides, and a sample's numbers must not depend on its batch. rows: where unknown i lies in the vectors
    given to `solve`, when those are longer than n.
    """

    def __init__(self, matrix: sp.spmatrix, rows: np.ndarray | None = None):
        lu = splu(
            sp.csc_matrix(matrix),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        if not np.array_equal(lu.perm_r, lu.perm_c):
            raise ValueError("the matrix is not symmetric positive definite: the factorisation had to pivot")
        n = matrix.shape[0]
        strict = sp.tril(lu.L, -1).tocsr()
        strict.sort_indices()
        transposed = strict.T.tocsr()
        transposed.sort_indices()
        permutation = np.argsort(lu.perm_c)
        self.order = (permutation if rows is None else rows[permutation]).astype(np.int32)
        self._lu = lu
        self._lower = (strict.indptr.astype(np.int64), strict.indices.astype(np.int32), strict.data)
        self._upper = (transposed.indptr.astype(np.int64), transposed.indices.astype(np.int32), transposed.data)
        self._diagonal = 1.0 / lu.U.diagonal()
        self._work = np.empty((n, LANES))
        self.nonzeros = strict.nnz + n

    def solve(self, b: np.ndarray) -> None:
        """Overwrite the unknowns' rows of b (·, LANES) with the solution."""
        _solve(self.order, *self._lower, *self._upper, self._diagonal, b, self._work)

    def solve_columns(self, b: np.ndarray) -> np.ndarray:
        """Solution (n, k) for right-hand sides (n, k), once, in setting up."""
        return self._lu.solve(b)
