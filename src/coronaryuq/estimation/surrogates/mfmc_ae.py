"""MFMC-AE: per row and fold, a curve of 0D inputs along which the 0D model follows the 3D quantity.

Two phases, because the real 0D model runs between them: `train` gives networks and, with `resampled`, the 0D inputs
that it needs; `along_curve` turns the 0D outputs into the control variate. As the latent space has one dimension, every
resampled input of one network lies on one curve, decode(z); the 0D model runs at `nodes` places of that curve and the
control variate interpolates between them. An interpolated function of θ is a control variate like any other, evaluated
alike on pilot and propagation samples, so the estimator stays exactly unbiased, and its 0D cost no longer grows with
N_0D.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from scipy.interpolate import PchipInterpolator

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.surrogates import autoencoder as ae
from coronaryuq.estimation.surrogates import shared_space

IN_SAMPLE = -1


@dataclass(frozen=True)
class Networks:
    """Trained networks of R rows and F fits (the folds, then all data), flat index b = row · F + fit.

    high, low: weights of the 3D and 0D autoencoders, (R F, ...). knots_high, knots_low (R F, KNOTS): their latents'
    quantiles. box (d, 2): θ at −1 and +1. loss (R F,): last value of the joint loss.
    """

    rows: tuple[str, ...]
    folds: int
    high: ae.Weights
    low: ae.Weights
    knots_high: torch.Tensor
    knots_low: torch.Tensor
    box: np.ndarray
    loss: np.ndarray

    def index(self, row: str, fold: int) -> int:
        """Return the place of a row and fold; fold IN_SAMPLE is the fit to all data."""
        return self.rows.index(row) * (self.folds + 1) + (self.folds if fold == IN_SAMPLE else fold)

    def select(self, row: str, fits: list[int]) -> "Networks":
        """Return one row's networks of the training sets `fits`, as folds in this order; the last is the fit to all."""
        at = [self.rows.index(row) * (self.folds + 1) + f for f in fits]
        high, low = ({name: value[at] for name, value in w.items()} for w in (self.high, self.low))
        return Networks(
            (row,), len(fits) - 1, high, low, self.knots_high[at], self.knots_low[at], self.box, self.loss[at]
        )

    def arrays(self) -> dict[str, np.ndarray]:
        """Return everything as named numpy arrays, for an `.npz` without pickle."""
        named = {"rows": np.array(self.rows), "folds": np.array(self.folds), "box": self.box}
        named |= {"loss": self.loss, "knots.high": self.knots_high.numpy(), "knots.low": self.knots_low.numpy()}
        for kind, weights in (("high", self.high), ("low", self.low)):
            named |= {f"{kind}.{name}": value.numpy() for name, value in weights.items()}
        return named

    @classmethod
    def from_arrays(cls, named: Mapping[str, np.ndarray]) -> "Networks":
        def weights(kind: str) -> ae.Weights:
            marks = (name for name in named if name.startswith(f"{kind}."))
            return {name.split(".", 1)[1]: torch.from_numpy(named[name]) for name in marks}

        return cls(
            tuple(str(row) for row in named["rows"]), int(named["folds"]), weights("high"), weights("low"),
            torch.from_numpy(named["knots.high"]), torch.from_numpy(named["knots.low"]),
            named["box"], named["loss"],
        )  # fmt: skip


Pair = tuple[str, np.ndarray, str, np.ndarray]
"""3D column and its values (n,), 0D column and its values (n,)."""


@dataclass(frozen=True)
class Training:
    """How to train: steps of both stages, samples per step, Adam's rate, its decay, restarts, correlation term."""

    steps: tuple[int, int]
    batch: int
    rate: float
    decay: float
    restarts: int
    correlation: str


def fits_of(fold: np.ndarray) -> list[np.ndarray]:
    """Return the training sets of cross-fitting: all runs but those of fold k, for every k, then all runs."""
    return [np.flatnonzero(fold != k) for k in range(int(fold.max()) + 1)] + [np.arange(len(fold))]


def train(
    theta: np.ndarray, box: np.ndarray, pairs: dict[str, Pair], fits: list[np.ndarray], how: Training, seed: int
) -> Networks:
    """Train both stages for every row and training set as one batch each.

    The first stage trains one autoencoder per distinct column and fit, because rows share columns; the second one
    couples a 3D and a 0D autoencoder.

    Parameters
    ----------
    theta, box
        Inputs (n, d), and θ at −1 and +1 (d, 2).
    pairs
        Row name → (3D column, y (n,), 0D column, q (n,)).
    fits
        Indices of the runs of each training set.
    how, seed
        Steps and rates, and the campaign's seed.
    """
    with ae.one_thread():
        inputs, share = _training_inputs(scale(theta, box), fits)
        columns = {("3d", c): y for c, y, _, _ in pairs.values()} | {("0d", c): q for _, _, c, q in pairs.values()}
        first, place = _first_stage(columns, inputs, share, fits, how, seed)
        high = [place["3d", pairs[row][0], f] for row in pairs for f in range(len(fits))]
        low = [place["0d", pairs[row][2], f] for row in pairs for f in range(len(fits))]
        outputs = torch.cat([_outputs(columns, [("3d", pairs[row][0]) for row in pairs], inputs, fits),
                             _outputs(columns, [("0d", pairs[row][2]) for row in pairs], inputs, fits)])  # fmt: skip
        repeat = [f for _ in pairs for f in range(len(fits))]
        both = {name: value[high + low] for name, value in first.items()}
        x, part = inputs[repeat], share[repeat]
        both, loss = _second_stage(both, x, outputs, part, how, seed)
        half = len(high)
        trained, zerod = ({name: value[s] for name, value in both.items()} for s in (slice(half), slice(half, None)))
        with torch.no_grad():
            knots_high, knots_low = (shared_space.knots(ae.encode(w, x), part) for w in (trained, zerod))
    return Networks(tuple(pairs), len(fits) - 1, trained, zerod, knots_high, knots_low, box, loss.numpy())


def scale(theta: np.ndarray, box: np.ndarray) -> torch.Tensor:
    """θ (n, d) in its units to (d, n) in [−1, 1]."""
    return torch.from_numpy(2 * (theta - box[:, 0]) / (box[:, 1] - box[:, 0]) - 1).float().T.contiguous()


def latent(networks: Networks, row: str, fold: int, theta: np.ndarray) -> np.ndarray:
    """Return the place (m,) of each θ (m, d) on the 0D latent axis, through the shared space."""
    b = networks.index(row, fold)
    with ae.one_thread(), torch.no_grad():
        x = scale(theta, networks.box)[None]
        z = ae.encode({name: value[b : b + 1] for name, value in networks.high.items()}, x)
        u = shared_space.to_uniform(z, networks.knots_high[b : b + 1])
        return shared_space.from_uniform(u, networks.knots_low[b : b + 1])[0, 0].double().numpy()


def resampled(networks: Networks, row: str, fold: int, z: np.ndarray) -> np.ndarray:
    """Return the 0D inputs θ (m, d) at places z (m,) of the 0D latent axis."""
    b = networks.index(row, fold)
    with ae.one_thread(), torch.no_grad():
        weights = {name: value[b : b + 1] for name, value in networks.low.items()}
        x = ae.decode(weights, torch.from_numpy(z).float()[None, None])[0].double().numpy().T
    low, high = networks.box[:, 0], networks.box[:, 1]
    return low + (x + 1) / 2 * (high - low)


def nodes(networks: Networks, row: str, fold: int, count: int) -> np.ndarray:
    """Return `count` places on the 0D latent axis, half of them at equal probabilities, half at equal distances."""
    at = networks.knots_low[networks.index(row, fold)].double().numpy()
    probable = np.interp(np.linspace(0, 1, count - count // 2), np.linspace(0, 1, len(at)), at)
    return np.sort(np.concatenate([probable, np.linspace(at[0], at[-1], count // 2 + 2)[1:-1]]))


def along_curve(z_nodes: np.ndarray, q_nodes: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return the 0D output (m,) at places z by monotone cubic interpolation between nodes; constant beyond the ends."""
    kept = np.concatenate([[True], np.diff(z_nodes) > 1e-9 * max(np.ptp(z_nodes), 1e-30)])
    if kept.sum() < 2:
        return np.full(len(z), q_nodes.mean())
    return PchipInterpolator(z_nodes[kept], q_nodes[kept])(np.clip(z, z_nodes[0], z_nodes[-1]))


def _training_inputs(x: torch.Tensor, fits: list[np.ndarray]) -> tuple[torch.Tensor, torch.Tensor]:
    """Stack inputs (F, d, n) and weights (F, 1, n) per fit; a shorter fit repeats its first sample at weight 0."""
    longest = max(len(f) for f in fits)
    padded = np.array([np.concatenate([f, np.full(longest - len(f), f[0])]) for f in fits])
    share = torch.zeros(len(fits), 1, longest)
    for i, f in enumerate(fits):
        share[i, 0, : len(f)] = 1 / len(f)
    return torch.stack([x[:, index] for index in padded]), share


def _outputs(columns, names, inputs, fits) -> torch.Tensor:
    """Stack outputs (names · F, 1, n), standardised by the moments of their own fit."""
    out = torch.zeros(len(names) * len(fits), 1, inputs.shape[2])
    for i, name in enumerate(names):
        for j, f in enumerate(fits):
            values = columns[name][f]
            standard = (values - values.mean()) / (values.std() or 1.0)
            out[i * len(fits) + j, 0, : len(f)] = torch.from_numpy(standard).float()
    return out


def _first_stage(columns, inputs, share, fits, how: Training, seed: int):
    """One autoencoder per column and fit, of the best restart; weights and (kind, column, fit) → place."""
    names = list(columns)
    slots = [(name, f) for name in names for f in range(len(fits))]
    rngs = [
        generator(seed, "estimation", "autoencoder", *name, f, restart)
        for restart in range(how.restarts) for name, f in slots
    ]  # fmt: skip
    weights = ae.initial_weights(rngs, inputs.shape[1])
    repeat = [f for _ in range(how.restarts) for _ in names for f in range(len(fits))]
    x, part, y = inputs[repeat], share[repeat], _outputs(columns, names, inputs, fits).repeat(how.restarts, 1, 1)
    draw = _batches(inputs.shape[2], how.batch, seed, "first")

    def loss(w):
        pick = next(draw)
        part_now = part[:, :, pick]
        return ae.reconstruction_loss(w, x[:, :, pick], y[:, :, pick], part_now / part_now.sum(2, keepdim=True))[0]

    weights = ae.adam(weights, loss, how.steps[0], how.rate, how.decay)
    with torch.no_grad():
        last, z = ae.reconstruction_loss(weights, x, y, part)
        # The shared space is monotone, so a latent axis along which the quantity is not monotone is useless there,
        # however well its surrogate fits: among restarts, one that orders the quantity is preferred.
        orders = correlation(y, shared_space.to_uniform(z, shared_space.knots(z, part))[:, None], part).abs()
        last = (last - orders).reshape(how.restarts, -1)
    best = last.nan_to_num(torch.inf).argmin(dim=0) * len(slots) + torch.arange(len(slots))
    place = {(*name, f): i for i, (name, f) in enumerate(slots)}
    return {name: value[best] for name, value in weights.items()}, place


def _second_stage(weights, x, y, share, how: Training, seed: int):
    """Joint training of 3D (first half) and 0D (second half) networks with the correlation term."""
    half = len(x)
    x, share = torch.cat([x, x]), torch.cat([share, share])
    draw = _batches(x.shape[2], max(how.batch, 200), seed, "second")

    def term(z, high, outputs, part):
        # ρ between the 3D outputs and the 0D surrogate at the places of the 0D latent axis that the shared space
        # gives them.
        at_high, at_low = shared_space.knots(z[:half], part[:half]), shared_space.knots(z[half:], part[half:])
        to = shared_space.to_uniform_kernel if how.correlation == "kernel" else shared_space.count
        low = {name: value[half:] for name, value in high.items()}
        follows = ae.surrogate(low, shared_space.from_uniform(to(z[:half], at_high), at_low))
        return correlation(outputs[:half], follows, part[:half])

    with torch.no_grad():
        # The direction of a latent axis is arbitrary: choose the one that correlates better before training.
        straight = term(ae.encode(weights, x), weights, y, share).abs()
        turned = ae.flip(weights, torch.arange(2 * half) >= half)
        which = term(ae.encode(turned, x), turned, y, share).abs() > straight
        weights = ae.flip(weights, torch.cat([torch.zeros_like(which), which]))

    def loss(w, whole=False):
        pick = slice(None) if whole else next(draw)
        part = share[:, :, pick]
        part = part / part.sum(2, keepdim=True)
        reconstruction, z = ae.reconstruction_loss(w, x[:, :, pick], y[:, :, pick], part)
        return reconstruction[:half] + reconstruction[half:] - term(z, w, y[:, :, pick], part).abs()

    weights = ae.adam(weights, loss, how.steps[1], how.rate / 2, how.decay)
    with torch.no_grad():
        return weights, loss(weights, whole=True)


def correlation(a: torch.Tensor, b: torch.Tensor, share: torch.Tensor) -> torch.Tensor:
    """Weighted Pearson correlation (B,) of (B, 1, n) tensors."""
    a, b = (v - (v * share).sum(2, keepdim=True) for v in (a, b))
    scale_ = ((a**2 * share).sum((1, 2)) * (b**2 * share).sum((1, 2)) + 1e-12).sqrt()
    return (a * b * share).sum((1, 2)) / scale_


def _batches(n: int, size: int, seed: int, stage: str):
    """Endless minibatches of positions, the same for every model of the batch."""
    rng = generator(seed, "estimation", "autoencoder", "batches", stage)
    size = min(size, n) if size else n
    while True:
        order = rng.permutation(n)
        for start in range(0, n - size + 1, size):
            yield torch.from_numpy(order[start : start + size])
