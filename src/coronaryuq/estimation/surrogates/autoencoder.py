"""Autoencoders with a one-dimensional latent space and a surrogate of one quantity, many of them trained as one batch.

Architecture and losses as in the paper's appendix A and its equations for L_3D and the joint loss. The first axis of
every tensor is the batch: model b has its own weights and its own training samples, so rows, folds and restarts differ
only in their place. Samples are the last axis, which is two to three times faster here than the first.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch

WIDTH, SURROGATE_WIDTH = 13, 10
PARTS = {
    "encoder": lambda d: [d, *[WIDTH] * 4, 1],
    "decoder": lambda d: [1, *[WIDTH] * 4, d],
    "surrogate": lambda d: [1, *[SURROGATE_WIDTH] * 2, 1],
}
Weights = dict[str, torch.Tensor]


@contextmanager
def one_thread() -> Iterator[None]:
    """Run torch on one thread, so that sums have one order: the same bits for any number of threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def initial_weights(generators: list, d: int) -> Weights:
    """Glorot-uniform weights for `len(generators)` models with d inputs, each drawn from its own numpy generator."""
    weights: Weights = {}
    for part, sizes in PARTS.items():
        for layer, (fan_in, fan_out) in enumerate(zip(sizes(d)[:-1], sizes(d)[1:], strict=True)):
            bound = (6 / (fan_in + fan_out)) ** 0.5
            drawn = [torch.from_numpy(rng.uniform(-bound, bound, (fan_out, fan_in))) for rng in generators]
            weights[f"{part}.{layer}.weight"] = torch.stack(drawn).float()
            weights[f"{part}.{layer}.bias"] = torch.zeros(len(generators), fan_out, 1)
    return weights


def encode(weights: Weights, x: torch.Tensor) -> torch.Tensor:
    """Map inputs (B, d, n), in [−1, 1], to the latent variable (B, 1, n)."""
    return _network(weights, "encoder", x)


def decode(weights: Weights, z: torch.Tensor) -> torch.Tensor:
    """Latent (B, 1, n) to inputs (B, d, n): a sigmoid keeps them within the box [−1, 1] that the encoder sees."""
    return 2 * torch.sigmoid(_network(weights, "decoder", z)) - 1


def surrogate(weights: Weights, z: torch.Tensor) -> torch.Tensor:
    """Latent (B, 1, n) to the standardised quantity (B, 1, n)."""
    return _network(weights, "surrogate", z)


def reconstruction_loss(
    weights: Weights, x: torch.Tensor, y: torch.Tensor, share: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the paper's four-term loss (B,) and the latents (B, 1, n); share (B, 1, n) sums to one over n."""
    z = encode(weights, x)
    again = decode(weights, z)
    z_again = encode(weights, again)
    value, value_again = surrogate(weights, z), surrogate(weights, z_again)
    terms = (y - value) ** 2 + (y - value_again) ** 2 + (value - value_again) ** 2
    terms = terms + ((again - decode(weights, z_again)) ** 2).mean(dim=1, keepdim=True)
    return (terms * share).sum(dim=(1, 2)), z


def flip(weights: Weights, which: torch.Tensor) -> Weights:
    """Reverse the latent axis of the models `which` (B,) bool; their functions stay the same."""
    sign = torch.where(which, -1.0, 1.0)[:, None, None]
    turned = dict(weights)
    for name in ("encoder.4.weight", "encoder.4.bias", "decoder.0.weight", "surrogate.0.weight"):
        turned[name] = weights[name] * sign
    return turned


def adam(weights: Weights, loss: Callable[[Weights], torch.Tensor], steps: int, rate: float, decay: float) -> Weights:
    """Minimise `loss(weights)` (B,) by `steps` of Adam, the rate falling by `decay` at each."""
    weights = {name: value.clone().requires_grad_(True) for name, value in weights.items()}
    optimiser = torch.optim.Adam(list(weights.values()), lr=rate)
    schedule = torch.optim.lr_scheduler.ExponentialLR(optimiser, decay)
    for _ in range(steps):
        optimiser.zero_grad(set_to_none=True)
        loss(weights).sum().backward()
        optimiser.step()
        schedule.step()
    return {name: value.detach() for name, value in weights.items()}


def _network(weights: Weights, part: str, x: torch.Tensor) -> torch.Tensor:
    """First and last layer linear, hyperbolic tangent in between."""
    layers = len(PARTS[part](1)) - 1
    for layer in range(layers):
        x = torch.baddbmm(weights[f"{part}.{layer}.bias"], weights[f"{part}.{layer}.weight"], x)
        if 0 < layer < layers - 1:
            x = torch.tanh(x)
    return x
