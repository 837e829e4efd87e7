"""Posterior marginals of the resistances, simulated flows and their targets, their covariance (Figs. 2, A.2)."""

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from coronaryuq.case.case_json import read_case
from coronaryuq.core.units import ML_PER_MIN
from coronaryuq.figures.style import MEASURED, SIMULATED, saved
from coronaryuq.perfusion.targets import read_perfusion_targets
from coronaryuq.posterior.results import read_summary


def marginals(posterior: str, case: str, output: str) -> None:
    """Draw the histogram of each bed's resistance as a multiple of r-hat, with mean and 95 % interval (Fig. 2a)."""
    beds, r, _ = _read(posterior)
    names, limits = _names(case), (r.min(), r.max())
    with _grid(output, len(beds)) as axes:
        for axis, bed, values in zip(axes, beds, r.T, strict=True):
            axis.hist(values, bins=np.linspace(*limits, 41), density=True, color=SIMULATED, alpha=0.75)
            low, high = np.quantile(values, [0.025, 0.975])
            axis.axvspan(low, high, color=SIMULATED, alpha=0.12, lw=0)
            axis.axvline(values.mean(), color="black", lw=1)
            axis.set_title(f"{names[bed]}: {values.mean():.2f} ({low:.2f} to {high:.2f})", fontsize=7.5)
            axis.set_yticks([])
        _label(axes, "resistance / r̂", "posterior density")


def flows(posterior: str, case: str, targets: str, summary: str, output: str) -> None:
    """Draw the simulated flow of each outlet, its target and the target's noise (Fig. 2b)."""
    beds, _, flow = _read(posterior)
    names, mean, covariance = _names(case), *_targets(targets, summary)
    spread = np.sqrt(np.diag(covariance))
    with _grid(output, len(beds)) as axes:
        for axis, bed, values, m, s in zip(axes, beds, flow.T, mean, spread, strict=True):
            axis.hist(values / ML_PER_MIN, bins=40, density=True, color=SIMULATED, alpha=0.75, label="simulated")
            x = np.linspace(m - 3.2 * s, m + 3.2 * s, 200)
            density = np.exp(-0.5 * ((x - m) / s) ** 2) / (s * math.sqrt(2 * math.pi))
            axis.plot(x / ML_PER_MIN, density * ML_PER_MIN, color=MEASURED, lw=1.2, label="noise of the target")
            axis.axvline(m / ML_PER_MIN, color="black", lw=1, ls="--", label="target")
            axis.set_title(names[bed], fontsize=8)
            axis.set_yticks([])
        _label(axes, "flow (mL/min)", "density")
        axes[0].figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)


def flow_covariance(posterior: str, case: str, targets: str, summary: str, output: str) -> None:
    """Draw simulated flows of each pair of outlets, and the ellipse of 95 % of the targets' noise (Fig. A.2)."""
    beds, _, flow = _read(posterior)
    names, mean, covariance = _names(case), *_targets(targets, summary)
    n, side = len(beds), 0.85 * len(beds)
    shown = flow[:: max(1, len(flow) // 250)] / ML_PER_MIN
    mean, covariance = mean / ML_PER_MIN, covariance / ML_PER_MIN**2
    with saved(output, nrows=n - 1, ncols=n - 1, figsize=(side, side), squeeze=False, layout=None) as (figure, axes):
        for row in range(1, n):
            for column in range(n - 1):
                axis = axes[row - 1][column]
                if column >= row:
                    axis.remove()
                    continue
                axis.plot(shown[:, column], shown[:, row], ".", ms=1.5, alpha=0.5, color=SIMULATED, rasterized=True)
                pair = np.ix_([column, row], [column, row])
                axis.plot(*_ellipse(mean[[column, row]], covariance[pair]), "--", color="black", lw=0.8)
                axis.tick_params(labelsize=4.5, length=2, pad=1)
                if row == n - 1:
                    axis.set_xlabel(names[beds[column]], fontsize=6.5)
                if column == 0:
                    axis.set_ylabel(names[beds[row]], fontsize=6.5)
        # Margins in inches; a constrained layout would measure every tick label of all panels.
        edge = 0.5 / side
        figure.subplots_adjust(edge, edge, 1 - edge / 4, 1 - edge, wspace=0.35, hspace=0.3)
        figure.suptitle("Outlet flows (mL/min): simulated (dots), 95 % of the targets' noise (dashed)", fontsize=9)


def _read(posterior: str) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Return beds, and multipliers and flows (draws, beds) of all chains."""
    import xarray

    data = xarray.load_dataset(posterior, group="posterior", engine="h5netcdf")
    beds = [str(bed) for bed in data["bed"].values]
    return beds, data["r"].values.reshape(-1, len(beds)), data["flow"].values.reshape(-1, len(beds))


def _names(case: str) -> dict[str, str]:
    return {outlet.bc: outlet.label for outlet in read_case(case).outlets}


def _targets(targets: str, summary: str) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and covariance of the targets as the likelihood uses them, scaled to the model's total."""
    content, factor = read_perfusion_targets(targets), read_summary(summary).target_scale
    return content.mean * factor, content.covariance * factor**2


def _ellipse(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the outline (2, n) that contains 95 % of a normal distribution in the plane."""
    values, vectors = np.linalg.eigh(covariance)
    angle = np.linspace(0, 2 * np.pi, 100)
    radius = math.sqrt(-2 * math.log(0.05))
    return mean[:, None] + radius * vectors @ (np.sqrt(values)[:, None] * np.stack([np.cos(angle), np.sin(angle)]))


@contextmanager
def _grid(output: str, panels: int, columns: int = 5) -> Iterator[list]:
    """Yield the axes of small panels, `columns` per row; the remaining ones are left empty."""
    rows = math.ceil(panels / columns)
    size = (2 * columns, 1.55 * rows + 0.5)
    with saved(output, nrows=rows, ncols=columns, figsize=size, squeeze=False) as (_, axes):
        for axis in axes.flat[panels:]:
            axis.set_axis_off()
        yield list(axes.flat[:panels])


def _label(axes: list, x: str, y: str) -> None:
    figure = axes[0].figure
    figure.supxlabel(x, fontsize=9)
    figure.supylabel(y, fontsize=9)
