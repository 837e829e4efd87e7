"""Noisy realisations of territories and MBF, each identified by its index."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.core.jit import njit
from coronaryuq.core.seeds import generator
from coronaryuq.perfusion.fields import FieldGrid, interpolate
from coronaryuq.perfusion.normals import is_certainly_above, quantile, uniform_at
from coronaryuq.perfusion.settings import NoiseModel
from coronaryuq.perfusion.territories import Ventricle

SIGMAS = 6.0


@dataclass(frozen=True)
class Candidates:
    """Outlets that may be nearest to a point under noise, nearest first; point p has entries start[p] to start[p + 1].

    An outlet is left out if it is farther than the nearest one by more than `SIGMAS` standard deviations of the
    difference of the two noisy distances. It would still win with probability 1e-9 per point, outlet and realisation,
    so this shortcut assigns at most an expected fraction of (outlets - 1) x 1e-9 of the volume to another territory.
    """

    start: np.ndarray
    outlet: np.ndarray
    distance: np.ndarray

    @classmethod
    def from_distances(cls, distances: np.ndarray, relative_sd: float, sigmas: float = SIGMAS) -> "Candidates":
        """Select candidates by noise-free `distances` (points, outlets) and their noise's total relative deviation."""
        nearest = distances.min(axis=1, keepdims=True)
        keep = distances - nearest <= sigmas * relative_sd * np.sqrt(distances**2 + nearest**2)
        start = np.concatenate([[0], np.cumsum(keep.sum(axis=1))]).astype(np.int64)
        point, outlet = np.nonzero(keep)
        nearest_first = np.lexsort((distances[keep], point))
        return cls(start, outlet[nearest_first].astype(np.uint8), distances[keep][nearest_first])


class NoiseStudy:
    """All noise models on one LV, with common random numbers.

    Models with the same distance noise have the same territories. Realisation k depends on the seed and k only.

    Parameters
    ----------
    ventricle : Ventricle
        The LV wall.
    distances : array (points, outlets)
        Noise-free distances, cm.
    models : dict of str to NoiseModel
        Noise models by name.
    length : float
        Correlation length of smooth noise, cm.
    seed : int
        The campaign's seed.
    sigmas : float
        See `Candidates`.
    """

    def __init__(
        self, ventricle: Ventricle, distances: np.ndarray, models: dict[str, NoiseModel], length: float, seed: int,
        sigmas: float = SIGMAS,
    ):  # fmt: skip
        self.ventricle, self.models, self.seed = ventricle, models, seed
        self.outlets = distances.shape[1]
        self._by_distance_noise: dict[tuple, list[str]] = {}
        for name, model in models.items():
            self._by_distance_noise.setdefault(tuple(model.distance.model_dump().items()), []).append(name)
        self.candidates = {
            noise: Candidates.from_distances(distances, float(np.sqrt(sum(sd**2 for _, sd in noise))), sigmas)
            for noise in self._by_distance_noise
        }
        correlated = any(model.distance.correlated or model.mbf.correlated for model in models.values())
        self.grid = FieldGrid.for_points(ventricle.points, length) if correlated else None

    def flows(self, index: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Simulate realisation `index`: model → (flow of each outlet in mL/s, volume of each territory in cm3)."""
        random = generator(self.seed, "perfusion", "realisation", index)
        keys = random.integers(0, 2**64, size=2, dtype=np.uint64)
        factors = random.standard_normal((2, self.outlets))
        scan = random.standard_normal()
        if self.grid is None:
            nodes = np.zeros((1, 1, 1, 1), dtype=np.float32)
            cell, weights = np.zeros((1, 3), dtype=np.int32), np.zeros((1, 3, 2), dtype=np.float32)
        else:
            nodes = self.grid.draw(random, self.outlets + 1)
            cell, weights = self.grid.cell, self.grid.weights
        result: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        for noise, names in self._by_distance_noise.items():
            candidates, distance = self.candidates[noise], dict(noise)
            mbf = [self.models[name].mbf for name in names]
            flow, volume = _realisation(
                self.ventricle.flows, self.ventricle.volumes,
                candidates.start, candidates.outlet, candidates.distance,
                distance["independent"], np.float32(distance["correlated"]), distance["outlet"] * factors[0],
                np.array([m.independent for m in mbf]), np.array([m.correlated for m in mbf], dtype=np.float32),
                np.array([m.outlet * factors[1] + m.scan * scan for m in mbf]),
                keys, nodes, cell, weights,
            )  # fmt: skip
            result.update((name, (flow[k], volume)) for k, name in enumerate(names))
        return {name: result[name] for name in self.models}


@njit(cache=True)
def _realisation(
    flows, volumes, start, outlet, distance, d_point, d_field, d_outlet, m_point, m_field, m_outlet, keys, nodes, cell,
    weights,
):  # fmt: skip
    models, outlets = m_outlet.shape
    flow = np.zeros((models, outlets))
    volume = np.zeros(outlets)
    has_field = d_field > 0.0 or m_field.max() > 0.0
    has_point_noise = m_point.max() > 0.0
    field = np.zeros(nodes.shape[3], dtype=np.float32)
    for p in range(flows.size):
        if has_field:
            interpolate(nodes, cell[p], weights[p], field)
        best, owner = np.inf, 0
        if start[p + 1] - start[p] == 1:
            owner = np.int64(outlet[start[p]])
        else:
            for c in range(start[p], start[p + 1]):
                j = np.int64(outlet[c])
                noise = d_outlet[j]
                if d_field > 0.0:
                    noise += d_field * field[j]
                if d_point > 0.0:
                    uniform = uniform_at(keys[0], np.uint64(p * outlets + j))
                    if is_certainly_above(uniform, (best / distance[c] - 1.0 - noise) / d_point):
                        continue
                    noise += d_point * quantile(uniform)
                noisy = distance[c] * (1.0 + noise)
                if noisy < best:
                    best, owner = noisy, j
        volume[owner] += volumes[p]
        normal = quantile(uniform_at(keys[1], np.uint64(p))) if has_point_noise else 0.0
        correlated = np.float64(field[outlets]) if has_field else 0.0
        for m in range(models):
            noise = m_outlet[m, owner] + m_field[m] * correlated + m_point[m] * normal
            flow[m, owner] += flows[p] * (1.0 + noise)
    return flow, volume
