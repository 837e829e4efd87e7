"""The posterior of the resistances and flows: against prior and targets, correlations, ranks of the chains."""

import math

import numpy as np

from coronaryuq.case.case_json import CaseOutlet, read_case
from coronaryuq.core.seeds import generator
from coronaryuq.core.units import ML_PER_MIN
from coronaryuq.figures.style import MUTED, Output, colour, saved
from coronaryuq.perfusion.targets import read_perfusion_targets
from coronaryuq.posterior.results import read_summary

HALF, WHOLE = (0.25, 0.75), (0.025, 0.975)
CORRELATION = "PuOr"
PERFECT = 2000
"""Simulated perfect chains behind the band of the ranks."""


def marginals(posterior: str, case: str, summary: str, output: Output) -> None:
    """Draw the posterior of each bed's resistance as a multiple of r-hat on its prior, as a forest plot."""
    beds, r, _ = _read(posterior)
    outlets = _outlets(case, beds)
    prior = read_summary(summary).prior_ranges
    with saved(output, figsize=(6.4, 0.22 * len(beds) + 0.8)) as (_, axis):
        for y, bed, outlet, values in zip(_places(beds), beds, outlets, _draws(r).T, strict=True):
            axis.plot(prior[bed], [y, y], lw=8, color=MUTED, alpha=0.3, solid_capstyle="butt", zorder=1)
            _range(axis, y, values, outlet)
        axis.axvline(1.0, color="black", lw=0.8, ls=":")
        _named(axis, outlets, "resistance / r̂")


def flows(posterior: str, case: str, targets: str, summary: str, output: Output) -> None:
    """Draw the simulated flow of each outlet on its target and the target's noise, as a forest plot."""
    beds, _, flow = _read(posterior)
    outlets, (mean, covariance) = _outlets(case, beds), _targets(targets, summary)
    reach = 1.96 * np.sqrt(np.diag(covariance))
    with saved(output, figsize=(6.4, 0.22 * len(beds) + 0.8)) as (_, axis):
        rows = zip(_places(beds), outlets, _draws(flow).T, mean, reach, strict=True)
        for y, outlet, values, m, s in rows:
            ends = np.array([m - s, m + s]) / ML_PER_MIN
            axis.plot(ends, [y, y], lw=8, color=MUTED, alpha=0.3, solid_capstyle="butt", zorder=1)
            axis.plot(m / ML_PER_MIN, y, "|", color="black", ms=10, mew=1.4, zorder=4)
            _range(axis, y, values / ML_PER_MIN, outlet)
        axis.set_xlim(left=0)
        _named(axis, outlets, "flow in hyperaemia (mL/min)")


def flow_correlation(posterior: str, case: str, targets: str, summary: str, output: Output) -> None:
    """Draw the correlations of simulated flows below the diagonal, of the targets' noise above it."""
    beds, _, flow = _read(posterior)
    outlets, (_, covariance) = _outlets(case, beds), _targets(targets, summary)
    spread = np.sqrt(np.diag(covariance))
    simulated, noise = np.corrcoef(_draws(flow).T), covariance / np.outer(spread, spread)
    below = np.tril(np.ones((len(beds), len(beds)), bool), -1)
    shown = np.where(below, simulated, noise)
    np.fill_diagonal(shown, np.nan)
    # Cells are as wide as their numbers, and no higher: the whole is printed on a third of a page.
    with saved(output, figsize=(0.4 * len(beds) + 1.4, 0.2 * len(beds) + 0.8)) as (figure, axis):
        picture = axis.imshow(shown, cmap=CORRELATION, vmin=-1, vmax=1, aspect="auto")
        for (row, column), value in np.ndenumerate(shown):
            if np.isfinite(value):
                ink = "white" if abs(value) > 0.7 else "black"
                axis.text(column, row, _signed(value), ha="center", va="center", fontsize=7, color=ink)
        for ticks, set_ticks in ((axis.get_xticklabels, axis.set_xticks), (axis.get_yticklabels, axis.set_yticks)):
            set_ticks(range(len(outlets)), [outlet.label for outlet in outlets])
            for text, outlet in zip(ticks(), outlets, strict=True):
                text.set_color(colour(outlet.branch))
        axis.tick_params(length=0)
        axis.tick_params(labelsize=7.5)
        axis.set_xlabel("below the diagonal: simulated; above: noise of the targets")
        for spine in axis.spines.values():
            spine.set_visible(False)
        bar = figure.colorbar(picture, ax=axis, shrink=0.8, aspect=24, pad=0.02)
        bar.set_label("correlation")
        bar.outline.set_visible(False)


def chains(posterior: str, case: str, output: Output) -> None:
    """Draw the distribution of every chain's ranks less that of a perfect chain (Säilynoja et al. 2022)."""
    beds, r, _ = _read(posterior)
    outlets, (number, length, _) = _outlets(case, beds), r.shape
    grid = np.linspace(0.0, 1.0, 101)
    reach = _band(number, length, grid)
    with saved(output, figsize=(6.4, 3.4)) as (_, axis):
        axis.fill_between(grid, -reach, reach, color=MUTED, alpha=0.3, lw=0)
        for bed, outlet in enumerate(outlets):
            rank = np.argsort(np.argsort(_draws(r)[:, bed])).reshape(number, length)
            for of_chain in np.sort((rank + 0.5) / (number * length), axis=1):
                difference = np.searchsorted(of_chain, grid, side="right") / length - grid
                axis.plot(grid, difference, lw=0.5, alpha=0.5, color=colour(outlet.branch))
        for branch in dict.fromkeys(outlet.branch for outlet in outlets):
            axis.plot([], [], color=colour(branch), label=f"outlets of the {branch}")
        axis.axhline(0.0, color="black", lw=0.8)
        axis.set(xlabel="rank among all draws / number of draws", ylabel="share of the chain below, less the rank")
        axis.legend(fontsize=7.5, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))


def _band(number: int, length: int, grid: np.ndarray) -> np.ndarray:
    """Return the distance (n,) from zero within which 95 % of perfect chains stay at every point of the grid."""
    draw = generator(1, "figures", "perfect chains")
    uniform = np.sort(draw.uniform(size=(PERFECT, length)), axis=1)
    share = np.stack([np.searchsorted(one, grid, side="right") for one in uniform]) / length
    # Ranks of one chain among several are drawn without replacement.
    scale = np.sqrt(grid * (1 - grid) / length)
    inside = scale > 0
    largest = (np.abs(share - grid)[:, inside] / scale[inside]).max(axis=1)
    return float(np.quantile(largest, 0.95)) * scale * math.sqrt((number - 1) / number if number > 1 else 1.0)


def _signed(value: float) -> str:
    """Format a correlation with one decimal, zero without a sign."""
    return "0" if abs(value) < 0.05 else f"{value:.1f}".replace("-", "−")


def _range(axis, y: float, values: np.ndarray, outlet: CaseOutlet) -> None:
    """Draw the central 95 and 50 % and the median of some values."""
    for share, width in ((WHOLE, 1.4), (HALF, 4.5)):
        axis.plot(np.quantile(values, share), [y, y], lw=width, color=colour(outlet.branch), zorder=2)
    axis.plot(np.median(values), y, "o", ms=4.5, color="white", mec=colour(outlet.branch), zorder=5)


def _places(beds: list[str]) -> list[int]:
    return list(range(len(beds)))[::-1]


def _named(axis, outlets: list[CaseOutlet], label: str) -> None:
    axis.set_yticks(_places([outlet.bc for outlet in outlets]), [outlet.label for outlet in outlets])
    for text, outlet in zip(axis.get_yticklabels(), outlets, strict=True):
        text.set_color(colour(outlet.branch))
    axis.tick_params(axis="y", length=0)
    axis.set_ylim(-0.7, len(outlets) - 0.3)
    axis.set_xlabel(label)
    axis.spines["left"].set_visible(False)


def _draws(values: np.ndarray) -> np.ndarray:
    """Return the draws of all chains, (draws, beds)."""
    return values.reshape(-1, values.shape[-1])


def _read(posterior: str) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Return beds, and multipliers and flows (chains, draws, beds)."""
    import xarray

    data = xarray.load_dataset(posterior, group="posterior", engine="h5netcdf")
    beds = [str(bed) for bed in data["bed"].values]
    return beds, data["r"].values, data["flow"].values


def _outlets(case: str, beds: list[str]) -> list[CaseOutlet]:
    """Return the outlet of every bed."""
    by_bed = {outlet.bc: outlet for outlet in read_case(case).outlets}
    return [by_bed[bed] for bed in beds]


def _targets(targets: str, summary: str) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and covariance of the targets as the likelihood uses them, scaled to the model's total."""
    content, factor = read_perfusion_targets(targets), read_summary(summary).target_scale
    return content.mean * factor, content.covariance * factor**2
