"""The shared space: map a latent variable to uniform by its distribution, and back into the other latent space.

The paper continues from the uniform to the standard normal; that map is the same for both models and cancels in the
composition, so it is left out here. Each map is represented by KNOTS quantiles of the training latents (B, KNOTS).
"""

import torch

KNOTS = 65


def knots(z: torch.Tensor, share: torch.Tensor) -> torch.Tensor:
    """Quantiles (B, KNOTS) at equal probabilities, extremes included, of the latents (B, 1, n) that have a share.

    Differentiable with respect to the latents.
    """
    values = z[:, 0].masked_fill(share[:, 0] == 0, float("inf")).sort(dim=1).values
    counts = (share[:, 0] > 0).sum(dim=1, keepdim=True)
    at = torch.linspace(0, 1, KNOTS, dtype=z.dtype)[None, :] * (counts - 1)
    low = at.floor().long().clamp(max=values.shape[1] - 2)
    low = torch.minimum(low, counts - 2)
    part = at - low
    return values.gather(1, low) * (1 - part) + values.gather(1, low + 1) * part


def to_uniform(z: torch.Tensor, at: torch.Tensor) -> torch.Tensor:
    """Interpolated empirical distribution function (B, n) of latents (B, 1, n), clamped to [0, 1]."""
    values = z[:, 0].contiguous()
    above = torch.searchsorted(at.contiguous(), values).clamp(1, KNOTS - 1)
    left, right = at.gather(1, above - 1), at.gather(1, above)
    part = ((values - left) / (right - left).clamp(min=1e-12)).clamp(0, 1)
    return (above - 1 + part) / (KNOTS - 1)


def to_uniform_kernel(z: torch.Tensor, at: torch.Tensor) -> torch.Tensor:
    """Kernel distribution function (B, n): logistic steps at the knots, a twentieth of the latents' range wide.

    Smooth in z and in the knots, so that the correlation term has a gradient in the 3D encoder, unlike a count.
    """
    width = 0.05 * (at[:, -1:] - at[:, :1]).clamp(min=1e-9)
    return torch.sigmoid((z - at[:, :, None]) / width[:, :, None]).mean(dim=1)


def count(z: torch.Tensor, at: torch.Tensor) -> torch.Tensor:
    """Evaluate the paper's empirical distribution function: the fraction of knots at or below z, without gradient."""
    return torch.searchsorted(at.detach().contiguous(), z[:, 0].detach().contiguous(), right=True).to(z.dtype) / KNOTS


def from_uniform(u: torch.Tensor, at: torch.Tensor) -> torch.Tensor:
    """Quantile (B, 1, n) of the other model's latents at u (B, n); linear between knots."""
    position = u.clamp(0, 1) * (KNOTS - 1)
    low = position.detach().floor().long().clamp(max=KNOTS - 2)
    part = position - low
    return (at.gather(1, low) * (1 - part) + at.gather(1, low + 1) * part)[:, None]
