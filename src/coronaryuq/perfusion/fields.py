"""Smooth random fields over the LV: white noise on a grid, filtered by a Gaussian, interpolated to the points."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.core.jit import njit

NODES_PER_LENGTH = 2
KERNEL_REACH = 3.0


@dataclass(frozen=True)
class FieldGrid:
    """Grid on which fields of unit variance and correlation exp(-d^2 / 2 l^2) are drawn.

    White noise filtered by a Gaussian of standard deviation l / sqrt(2) has that correlation. Interpolation between
    nodes lowers the variance. Filter, interpolation and therefore the variance are products over the axes, so dividing
    each point's weights by its standard deviation per axis gives every point a variance of exactly one.

    shape: nodes with noise, per axis. kernel: (2 m + 1,) unit-norm filter. cell: (points, 3) node below each point, in
    the filtered grid, which is m nodes smaller on each side. weights: (points, 3, 2) per axis, float32.
    """

    shape: tuple[int, int, int]
    kernel: np.ndarray
    cell: np.ndarray
    weights: np.ndarray

    @classmethod
    def for_points(cls, points: np.ndarray, length: float) -> "FieldGrid":
        """Make the grid for `points` (n, 3) and correlation length `length`, in the same unit."""
        spacing = length / NODES_PER_LENGTH
        width = NODES_PER_LENGTH / np.sqrt(2.0)
        reach = int(np.ceil(KERNEL_REACH * width))
        kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
        kernel /= np.sqrt(np.sum(kernel**2))
        neighbours = np.sum(kernel[1:] * kernel[:-1])
        position = (points - points.min(axis=0)) / spacing
        cell = np.floor(position).astype(np.int32)
        t = position - cell
        weights = np.stack([1.0 - t, t], axis=2)
        variance = (1.0 - t) ** 2 + t**2 + 2.0 * t * (1.0 - t) * neighbours
        weights /= np.sqrt(variance)[:, :, None]
        nx, ny, nz = (int(n) for n in cell.max(axis=0) + 2 + 2 * reach)
        return cls((nx, ny, nz), kernel.astype(np.float32), cell, weights.astype(np.float32))

    def draw(self, random: np.random.Generator, fields: int) -> np.ndarray:
        """Draw node values (nx, ny, nz, fields), float32, of independent fields, for `interpolate`."""
        noise = random.standard_normal((*self.shape, fields), dtype=np.float32)
        return _filtered(noise, self.kernel)


@njit(cache=True)
def _filtered(noise: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    values = noise
    for axis in range(3):
        outer = 1
        for a in range(axis):
            outer *= values.shape[a]
        inner = values.shape[3]
        for a in range(axis + 1, 3):
            inner *= values.shape[a]
        rows = values.shape[axis] - kernel.size + 1
        source = values.reshape(outer, values.shape[axis], inner)
        out = np.zeros((outer, rows, inner), dtype=np.float32)
        for o in range(outer):
            for r in range(rows):
                target = out[o, r]
                for k in range(kernel.size):
                    weight = kernel[k]
                    row = source[o, r + k]
                    for i in range(inner):
                        target[i] += weight * row[i]
        if axis == 0:
            values = out.reshape(rows, values.shape[1], values.shape[2], values.shape[3])
        elif axis == 1:
            values = out.reshape(values.shape[0], rows, values.shape[2], values.shape[3])
        else:
            values = out.reshape(values.shape[0], values.shape[1], rows, values.shape[3])
    return values


@njit(cache=True)
def interpolate(nodes: np.ndarray, cell: np.ndarray, weights: np.ndarray, out: np.ndarray) -> None:
    """Interpolate all fields at a point with `cell` (3,) and `weights` (3, 2) into `out` (fields,)."""
    i, j, k = cell[0], cell[1], cell[2]
    corner = nodes[i : i + 2, j : j + 2, k : k + 2]
    a, b, c, d = corner[0, 0, 0], corner[0, 0, 1], corner[0, 1, 0], corner[0, 1, 1]
    e, f, g, h = corner[1, 0, 0], corner[1, 0, 1], corner[1, 1, 0], corner[1, 1, 1]
    near, far, left, right = weights[0, 0], weights[0, 1], weights[2, 0], weights[2, 1]
    low, high = weights[1, 0], weights[1, 1]
    for n in range(out.size):
        out[n] = near * (low * (left * a[n] + right * b[n]) + high * (left * c[n] + right * d[n])) + far * (
            low * (left * e[n] + right * f[n]) + high * (left * g[n] + right * h[n])
        )
