"""Sparse Cholesky factors, shared by all samples or one for each; triangular solves with the sample index innermost."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from coronaryuq.core.jit import njit
from coronaryuq.core.simd import fma, store
from coronaryuq.flow3d.fem.lanes import LANES, entry, load, splat


@njit(cache=True, error_model="numpy")
def _solve(order, low_start, low_row, low_value, up_start, up_row, up_value, diagonal, b, x):
    n = order.shape[0]
    for i in range(n):
        total, other = load(b, np.int64(order[i])), splat(0.0)
        k, end = low_start[i], low_start[i + 1]
        while k + 2 <= end:
            total = fma(-1.0 * entry(low_value, k), load(x, np.int64(low_row[k])), total)
            other = fma(-1.0 * entry(low_value, k + 1), load(x, np.int64(low_row[k + 1])), other)
            k += 2
        if k < end:
            total = fma(-1.0 * entry(low_value, k), load(x, np.int64(low_row[k])), total)
        store(x, i, total + other)
    for i in range(n - 1, -1, -1):
        total, other = entry(diagonal, i) * load(x, i), splat(0.0)
        k, end = up_start[i], up_start[i + 1]
        while k + 2 <= end:
            total = fma(-1.0 * entry(up_value, k), load(x, np.int64(up_row[k])), total)
            other = fma(-1.0 * entry(up_value, k + 1), load(x, np.int64(up_row[k + 1])), other)
            k += 2
        if k < end:
            total = fma(-1.0 * entry(up_value, k), load(x, np.int64(up_row[k])), total)
        total = total + other
        store(x, i, total)
        store(b, np.int64(order[i]), total)


class Cholesky:
    """LDLᵀ of symmetric positive definite matrices (n, n), factored once and used by every step.

    One matrix serves all samples, or each sample has its own; these have one sparsity pattern and one elimination
    order. The triangular solves are written out because those of libraries may round differently for another number of
    right-hand sides, and a sample's numbers must not depend on its batch. places: row of unknown i in the vectors given
    to `solve`, if these are longer than n.
    """

    def __init__(self, matrix: sp.spmatrix, places: np.ndarray | None = None):
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
        self.order = (permutation if places is None else places[permutation]).astype(np.int32)
        self._lu = lu
        self._lower = (strict.indptr.astype(np.int64), strict.indices.astype(np.int32), strict.data)
        self._upper = (transposed.indptr.astype(np.int64), transposed.indices.astype(np.int32), transposed.data)
        self._diagonal = 1.0 / lu.U.diagonal()
        self._work = np.empty((n, LANES))
        self.nonzeros = strict.nnz + n

    @classmethod
    def of_lanes(cls, factors: Sequence["Cholesky"], pattern: sp.spmatrix) -> "Cholesky":
        """Return the factors (LANES,) of matrices of one pattern as one, each used by its own sample.

        SuperLU leaves out entries that happen to be zero. Here the factors have every entry that the pattern alone
        implies, found by factoring a matrix without cancellation, so that the order of a sample's operations does not
        depend on its batch. Their values are kept in single precision, which halves what a step reads from memory: they
        solve for the pressure's change over a step, so that the error is a small part of a small change, and the caps'
        flows do not come from them.
        """
        joined = cls(_without_cancellation(sp.csr_matrix(pattern, copy=True)))
        joined.order, joined._lu = factors[0].order, None
        n = len(joined.order)
        for triangle in ("_lower", "_upper"):
            start, column, _ = getattr(joined, triangle)
            key = np.repeat(np.arange(n), np.diff(start)) * n + column
            values = np.zeros((len(key), LANES), np.float32)
            for lane, factor in enumerate(factors):
                own_start, own_column, own = getattr(factor, triangle)
                own_key = np.repeat(np.arange(n), np.diff(own_start)) * n + own_column
                place = np.minimum(np.searchsorted(key, own_key), len(key) - 1)
                if not (np.array_equal(factor.order, joined.order) and np.array_equal(key[place], own_key)):
                    raise ValueError("factors of different patterns: the meshes do not have the same topology")
                values[place, lane] = own
            setattr(joined, triangle, (start, column, values))
        joined._diagonal = np.stack([factor._diagonal for factor in factors], axis=-1)
        return joined

    def solve(self, b: np.ndarray) -> None:
        """Overwrite the unknowns' rows of b (·, LANES) with the solution."""
        _solve(self.order, *self._lower, *self._upper, self._diagonal, b, self._work)

    def solve_columns(self, b: np.ndarray) -> np.ndarray:
        """Return the solution (n, k) for right-hand sides (n, k); for the set-up of one matrix only."""
        return self._lu.solve(b)


def _without_cancellation(matrix: sp.csr_matrix) -> sp.csr_matrix:
    """Give a matrix the values of a graph's Laplacian plus one, whose factor has every entry its pattern implies."""
    size = np.diff(matrix.indptr)
    row = np.repeat(np.arange(matrix.shape[0]), size)
    matrix.data = np.where(matrix.indices == row, size[row].astype(float), -1.0)
    return matrix
