"""Sparse Cholesky factor shared by all samples; triangular solves with the sample index innermost."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from coronaryuq.core.jit import njit
from coronaryuq.core.simd import fma, store
from coronaryuq.flow3d.fem.lanes import LANES, load, splat


@njit(cache=True, error_model="numpy")
def _solve(order, low_start, low_row, low_value, up_start, up_row, up_value, diagonal, b, x):
    n = order.shape[0]
    for i in range(n):
        total, other = load(b, np.int64(order[i])), splat(0.0)
        k, end = low_start[i], low_start[i + 1]
        while k + 2 <= end:
            total = fma(-low_value[k], load(x, np.int64(low_row[k])), total)
            other = fma(-low_value[k + 1], load(x, np.int64(low_row[k + 1])), other)
            k += 2
        if k < end:
            total = fma(-low_value[k], load(x, np.int64(low_row[k])), total)
        store(x, i, total + other)
    for i in range(n - 1, -1, -1):
        total, other = diagonal[i] * load(x, i), splat(0.0)
        k, end = up_start[i], up_start[i + 1]
        while k + 2 <= end:
            total = fma(-up_value[k], load(x, np.int64(up_row[k])), total)
            other = fma(-up_value[k + 1], load(x, np.int64(up_row[k + 1])), other)
            k += 2
        if k < end:
            total = fma(-up_value[k], load(x, np.int64(up_row[k])), total)
        total = total + other
        store(x, i, total)
        store(b, np.int64(order[i]), total)


class Cholesky:
    """LDLᵀ of a symmetric positive definite matrix (n, n), factored once and used by every sample and step.

    The triangular solves are written out because those of libraries may round differently for another number of
    right-hand sides, and a sample's numbers must not depend on its batch. rows: row of unknown i in the vectors given
    to `solve`, if these are longer than n.
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
        """Return the solution (n, k) for right-hand sides (n, k); for the set-up only."""
        return self._lu.solve(b)
