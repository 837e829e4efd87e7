"""Draw total-resistance.png and print its numbers: the constrained posterior, exact and rescaled after acceptance."""

from pathlib import Path

import numpy as np
from scipy import stats

from coronaryuq.figures.style import MEASURED, SIMULATED, saved
from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.model.total_resistance import Conditioned, Rescaled
from coronaryuq.posterior.sampler.diagnostics import split_rhat
from coronaryuq.posterior.sampler.dream import Dream
from coronaryuq.posterior.settings import DreamSettings

PRIOR = (0.5, 2.0)
FEW = np.array([0.5, 0.3, 0.2])
SHARES = np.array([0.19, 0.13, 0.11, 0.10, 0.08, 0.07, 0.06, 0.055, 0.05, 0.045, 0.04, 0.03, 0.025, 0.015])
"""Of 14 beds, from large to small."""


def brute_force(weights: np.ndarray, count: int, width: float = 0.004) -> np.ndarray:
    """Return uniform multipliers that happen to keep the total conductance within `width`: needs no derivation."""
    random, kept = np.random.default_rng(7), []
    while sum(map(len, kept)) < count:
        m = random.uniform(*PRIOR, size=(400_000, len(weights)))
        kept.append(m[np.abs(np.sum(weights / m, axis=1) - 1) < width])
    return np.concatenate(kept)[:count]


def chains(space: Conditioned | Rescaled, log_likelihood, generations: int) -> np.ndarray:
    """Multipliers (chains, draws, N) after burn-in."""
    dream = Dream(
        lambda x: (space.log_prior(x) + log_likelihood(np.nan_to_num(space.multipliers(x), nan=1.0)), x[:, :0]),
        DreamSettings(generations=generations), 3, box=space.box, adjust=space.adjust,
    )  # fmt: skip
    state, draws = dream.start(space.draw(np.random.default_rng(2), 24)), []
    for _ in range(dream.decisions):
        dream.advance(state)
        draws.append(space.multipliers(state.position.copy()))
    return np.array(draws[dream.burn_in :]).swapaxes(0, 1)


def both(weights: np.ndarray, log_likelihood, generations: int) -> tuple[np.ndarray, np.ndarray]:
    kinds = (Conditioned(weights, PRIOR), Rescaled(weights, PRIOR))
    return tuple(chains(space, log_likelihood, generations) for space in kinds)


def density(axis, draws: np.ndarray, **style) -> None:
    counts, edges = np.histogram(draws, bins=np.linspace(0.4, 3.0, 105), density=True)
    axis.stairs(counts, edges, **style)


def main() -> None:
    exact = brute_force(FEW, 60_000)
    conditioned, rescaled = both(FEW, lambda m: np.zeros(len(m)), 25_000)
    weights = SHARES / SHARES.sum()
    likelihood = Likelihood(weights, np.diag((0.2 * weights) ** 2))
    with_data = both(weights, lambda m: likelihood.log_density(weights / m), 25_000)
    shown = (0, 6, 13)
    with saved(
        str(Path(__file__).parents[1] / "docs" / "pictures" / "total-resistance.png"), nrows=2, ncols=3, figsize=(9, 5)
    ) as (figure, a):
        for i in range(3):
            density(a[0, i], exact[:, i], fill=True, color="0.8", label="brute force")
            density(a[0, i], conditioned[:, :, i], color=SIMULATED, label="conditioned (default)")
            density(a[0, i], rescaled[:, :, i], color=MEASURED, label="rescaled after acceptance")
            a[0, i].set_title(f"no data, fraction of conductance {FEW[i]:g}", fontsize=8)
            bed = shown[i]
            density(a[1, i], with_data[0][:, :, bed], color=SIMULATED)
            density(a[1, i], with_data[1][:, :, bed], color=MEASURED)
            a[1, i].set_title(f"14 beds, targets with 20 % noise, fraction {weights[bed]:.3f}", fontsize=8)
        for axis in a.flat:
            axis.set_yticks([])
            axis.set_xlim(0.4, 2.7)
        figure.supxlabel("resistance / r̂", fontsize=9)
        figure.supylabel("density", fontsize=9)
        figure.legend(*a[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    for i, share in enumerate(FEW):
        p = [stats.ks_2samp(x[:, ::40, i].ravel(), exact[:, i]).pvalue for x in (conditioned, rescaled)]
        print(f"no data, fraction {share}: mean {exact[:, i].mean():.4f} exact, {conditioned[..., i].mean():.4f} "
              f"conditioned, {rescaled[..., i].mean():.4f} rescaled; p {p[0]:.2g}, {p[1]:.2g}")  # fmt: skip
    log = [np.log(x) for x in with_data]
    mean, spread = ([x.mean(axis=(0, 1)) for x in log], [x.std(axis=(0, 1)) for x in log])
    shift, ratio = (mean[1] - mean[0]) / spread[0], spread[1] / spread[0]
    print(f"14 beds with data: means of log r move by {shift.min():.3f} to {shift.max():.3f} sd, "
          f"sds by {100 * (ratio - 1).min():.1f} to {100 * (ratio - 1).max():.1f} %; "
          f"R-hat {split_rhat(log[0][:, ::20]).max():.3f}, {split_rhat(log[1][:, ::20]).max():.3f}")  # fmt: skip
    fraction = weights / with_data[0]
    error = fraction.mean(axis=(0, 1)) / weights - 1
    print(f"posterior mean flow fractions off their targets by {100 * error.min():.1f} to {100 * error.max():.1f} %")


if __name__ == "__main__":
    main()
