"""Figures of the search for missing effects, each drawn from one table.

With the case of the network and its tree, vessels, beds and places have the names that a reader knows.
"""

from collections.abc import Callable
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.patheffects import withStroke

from coronaryuq.case.anatomy.tree import read_tree
from coronaryuq.case.case_json import read_case
from coronaryuq.case.network.network_names import InWords
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.table_model.tables import artery
from coronaryuq.figures.style import MUTED, saved
from coronaryuq.figures.units_shown import shown_in
from coronaryuq.zerod.effects.library import effect as named_effect

MEASURED, BEFORE, AFTER, FLEXIBLE = "#000000", "#8C7AB8", "#B5477F", "#8A6D1D"
TOGETHER = "#4B2E83"
BY_CHANCE = 3.0
"""Largest misfit of a vessel, in standard deviations, that is likely by chance, as the caption says."""
MOST_PANELS = 6


def words_of(case: str | Path | None, tree: str | Path | None) -> Callable[[Any], Any]:
    """Return what puts the names of a network in words: those of a case and its tree; without them names stay.

    Parameters
    ----------
    case
        `case.json`.
    tree
        `tree.vtp`.
    """
    if case is None or tree is None:
        return lambda names: names
    summary = read_case(case)
    return InWords.of(read_tree(tree), summary.outlets, summary.stenoses, summary.systemic)


def tree(table: str | Path, output: str | Path, case: str | Path | None = None, tree: str | Path | None = None) -> None:
    """Draw the tree from left to right, coloured by the largest misfit (sd); grey: not measured.

    A labelled diamond is a named effect: on the vessel where it acts, or at its end if it acts at the bed.
    """
    frame, in_words = read_csv(table, ("vessel", "parent", "disagreement", "named")), words_of(case, tree)
    children: dict[str, list[str]] = {}
    for row in frame.itertuples(index=False):
        children.setdefault(row.parent if isinstance(row.parent, str) else "", []).append(row.vessel)
    place: dict[str, tuple[float, float]] = {}

    def place_subtree(name: str, depth: int, leaf: int) -> int:
        below = children.get(name, [])
        first = leaf
        for child in below:
            leaf = place_subtree(child, depth + 1, leaf)
        if not below:
            leaf += 1
        heights = [place[child][1] for child in below]
        place[name] = (depth, float(np.mean(heights)) if heights else float(first))
        return leaf

    leaves = 0
    for root in children.get("", []):
        leaves = place_subtree(root, 0, leaves)
    worst = dict(zip(frame.vessel, frame.disagreement, strict=True))
    # So that what is likely by chance is pale.
    largest = max(3.0 * BY_CHANCE, float(np.nanmax(frame.disagreement.to_numpy(), initial=0.0)))
    shades = np.interp(np.linspace(0.0, largest, 256), [0.0, BY_CHANCE, largest], [0.12, 0.3, 1.0])
    norm, colours = Normalize(0.0, largest), ListedColormap(colormaps["YlOrRd"](shades))
    parents = dict(zip(frame.vessel, frame.parent, strict=True))
    named = {row.vessel: row.named.split("; ") for row in frame.itertuples() if isinstance(row.named, str)}
    # As low as the labels allow: print scales a figure to a quarter of a page.
    with saved(output, figsize=(9.0, max(2.0, 0.14 * leaves + 0.6))) as (canvas, axes):
        for name, (depth, height) in place.items():
            parent = parents[name]
            start = place[parent][1] if isinstance(parent, str) and parent in place else height
            known = np.isfinite(worst[name])
            colour = colours(norm(worst[name])) if known else MUTED
            line = {"color": colour, "lw": 3 if known else 1.5, "zorder": 2 if known else 1}
            axes.plot([depth, depth, depth + (1.0 if name in children else 0.8)], [start, height, height], **line)
            if leaves <= 12 or known or name in named:
                text = axes.text(depth + 0.05, height + 0.12, in_words(name), fontsize=7, va="bottom", zorder=3)
                text.set_path_effects([withStroke(linewidth=2, foreground="white")])
            _mark(axes, name, depth, height, 1.0 if name in children else 0.8, named.get(name, []))
        axes.set_axis_off()
        axes.set_ylim(-0.5, max(leaves - 1, 0) + 0.7)
        title = "Largest misfit after recalibration (in standard deviations expected by chance); grey: not measured"
        axes.set_title(title, loc="left")
        bar = canvas.colorbar(ScalarMappable(norm, colours), ax=axes, shrink=0.7, label="largest misfit (sd)")
        bar.ax.axhline(BY_CHANCE, color="black", lw=1.5)


def _mark(axes, vessel: str, depth: float, height: float, length: float, named: list[str]) -> None:
    """Mark the effects that act at a vessel ("EFFECT at PLACE") by labelled diamonds, in its middle or at its end.

    Of a vessel that feeds no other, all labels are behind its end: below it is the name of the next one.
    """
    labels: dict[bool, list[str]] = {True: [], False: []}
    for name in named:
        effect, place = name.split(" at ", 1)
        labels[vessel in place.split("~")].append(effect.replace("_", " "))
    last, apart = length < 1.0, 4.0 * all(labels.values())
    for own, words in labels.items():
        if words:
            x, end = depth + (0.5 if own else 1.0) * length, depth + length
            axes.plot(x, height, "D", ms=5, color=AFTER, mec="white", mew=0.8, zorder=4, clip_on=False)
            at, offset, ha, va = (end, (6, apart if own else -apart), "left", "center")
            if own and not last:
                at, offset, ha, va = x, (0, -5), "center", "top"
            style = {"fontsize": 7, "color": AFTER, "ha": ha, "va": va, "zorder": 4}
            text = axes.annotate(", ".join(words), (at, height), offset, textcoords="offset points", **style)
            text.set_path_effects([withStroke(linewidth=2, foreground="white")])


def residuals(
    table: str | Path, output: str | Path, case: str | Path | None = None, tree: str | Path | None = None
) -> None:
    """Draw the waveforms with the largest misfit: measured with its noise, recalibrated, repaired.

    Without waveforms: predicted against measured values, a panel per quantity.
    """
    frame = read_csv(
        table, ("condition", "quantity", "location", "statistic", "phase", "measured", "sd", "recalibrated", "named")
    )
    in_words = words_of(case, tree)
    waves = frame[frame.statistic == "waveform"]
    groups = list(waves.groupby(["quantity", "location", "condition"], sort=False))
    groups.sort(key=lambda item: -float(np.mean(((item[1].measured - item[1].recalibrated) / item[1].sd) ** 2)))
    groups = groups[:MOST_PANELS]
    if not groups:
        return _against_measured(frame, output)
    columns = min(3, len(groups))
    rows = -(-len(groups) // columns)
    size = 3.0 * columns, 1.75 * rows + 0.3
    with saved(output, nrows=rows, ncols=columns, figsize=size, squeeze=False) as (canvas, axes):
        for number, ((quantity, location, condition), part) in enumerate(groups):
            axis = axes.flat[number]
            part = part.assign(phase=part.phase % 1.0).sort_values("phase")
            phase = part.phase.to_numpy()
            scale, unit = shown_in(quantity)
            measured, sd = part.measured / scale, part.sd / scale
            axis.errorbar(phase, measured, sd, fmt=".", ms=3, lw=0.6, color=MEASURED, label="measured ± sd")
            axis.plot(phase, part.recalibrated / scale, color=BEFORE, lw=1.2, label="recalibrated")
            axis.plot(phase, part.repaired / scale, color=AFTER, lw=1.2, label=after_label(frame))
            held = "" if bool(part.fitted.all()) else ", held out"
            axis.set_title(f"{quantity} at {in_words(location)}\n{condition}{held}", fontsize=7)
            if number + columns >= len(groups):
                axis.set_xlabel("phase of the beat")
            axis.set_ylabel(unit)
        for axis in axes.flat[len(groups) :]:
            axis.set_axis_off()
        handles, labels = axes.flat[0].get_legend_handles_labels()
        canvas.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7)


def after_label(frame: pd.DataFrame) -> str:
    """Return the label of the repaired model."""
    return "with the named effects" if bool(frame.named.all()) else "with the most probable effect"


def _against_measured(frame: pd.DataFrame, output: str | Path) -> None:
    """Draw predicted against measured values, a panel per quantity, before and after; squares: held out."""
    names = list(dict.fromkeys(frame.quantity))
    drawn = {}
    with saved(output, ncols=len(names), figsize=(3.4 * len(names), 3.9), squeeze=False) as (canvas, axes):
        for axis, quantity in zip(axes.flat, names, strict=True):
            part, (scale, unit) = frame[frame.quantity == quantity], shown_in(quantity)
            values = part[["measured", "recalibrated", "repaired"]].to_numpy() / scale
            ends = [values.min(), values.max()]
            axis.plot(ends, ends, color=MUTED, lw=1, zorder=1)
            for key, colour, size, label in (
                ("recalibrated", BEFORE, 6, "recalibrated"),
                ("repaired", AFTER, 4, after_label(frame)),
            ):
                for fitted, marker, which in ((True, "o", "fitted"), (False, "s", "held out")):
                    points = part[part.fitted.astype(bool) == fitted]
                    if len(points):
                        style = {"fmt": marker, "ms": size, "mfc": colour if fitted else "white", "color": colour}
                        xy = points.measured / scale, points[key] / scale
                        drawn[f"{label}, {which}"] = axis.errorbar(*xy, xerr=points.sd / scale, lw=0.8, **style)
            unit_text = f" ({unit})" if unit else ""
            axis.set(title=quantity, xlabel=f"measured ± sd{unit_text}", ylabel=f"predicted{unit_text}", aspect="equal")
        canvas.legend(drawn.values(), drawn.keys(), loc="outside lower center", ncols=2, fontsize=6)


def ranking(
    table: str | Path, output: str | Path, case: str | Path | None = None, tree: str | Path | None = None
) -> None:
    """Draw the probabilities of each round's candidates, the accepted one coloured, and of the other answers."""
    frame, in_words = read_csv(table, ("round", "effect", "place", "probability", "accepted")), words_of(case, tree)
    rounds = sorted(frame["round"].unique()) or [1]
    with saved(output, ncols=len(rounds), figsize=(4.2 * len(rounds), 3.0), squeeze=False) as (_, axes):
        for axis, number in zip(axes.flat, rounds, strict=True):
            part = frame[frame["round"] == number].nlargest(8, "probability").iloc[::-1]
            names = [
                f"{e.replace('_', ' ')}\n{in_words(p)}" if isinstance(p, str) else e
                for e, p in zip(part.effect, part.place, strict=True)
            ]
            colours = [AFTER if accepted else MUTED for accepted in part.accepted]
            axis.barh(range(len(part)), part.probability, color=colours)
            axis.set_yticks(range(len(part)), names, fontsize=6)
            axis.set_xlim(0, 1)
            axis.set_xlabel("probability")
            axis.set_title(f"round {number}")


def sizes(
    table: str | Path, output: str | Path, case: str | Path | None = None, tree: str | Path | None = None
) -> None:
    """Draw posterior and prior densities of the sizes of the named effects."""
    frame = read_csv(table, ("effect", "place", "parameter", "size", "posterior", "prior"))
    groups, in_words = list(frame.groupby(["effect", "place", "parameter"], sort=False)), words_of(case, tree)
    with saved(output, ncols=max(1, len(groups)), figsize=(3.4 * max(1, len(groups)), 2.6), squeeze=False) as (_, axes):
        if not groups:
            axes.flat[0].text(0.5, 0.5, "no effect was named", ha="center")
            axes.flat[0].set_axis_off()
        for axis, ((effect, place, parameter), part) in zip(axes.flat, groups, strict=False):
            axis.plot(part["size"], part.posterior, color=AFTER, label="posterior")
            axis.plot(part["size"], part.prior, color=MUTED, ls="--", label="prior")
            axis.set_title(f"{effect.replace('_', ' ')}\n{in_words(place)}", fontsize=7)
            axis.set_xlabel(fill(_meaning(effect, parameter), 45))
            axis.set_ylabel("density")
            axis.legend(fontsize=6)


def _meaning(effect: str, parameter: str) -> str:
    """Return what a size of an effect is, with its unit."""
    return next(one.meaning for one in named_effect(effect).parameters if one.name == parameter)


def gap(table: str | Path, output: str | Path) -> None:
    """Draw the misfit on held-out data with 90 % intervals, and that expected from noise and fit uncertainty."""
    frame: pd.DataFrame = read_csv(table, ("model", "misfit", "low", "high", "expected_misfit"))
    with saved(output, figsize=(5.5, 0.7 + 0.375 * len(frame))) as (_, axes):
        heights = np.arange(len(frame))[::-1]
        colours = [BEFORE, AFTER, FLEXIBLE, TOGETHER, MEASURED][: len(frame)]
        low, high = (np.clip(d, 0, None) for d in (frame.misfit - frame.low, frame.high - frame.misfit))
        for y, row, colour, a, b in zip(heights, frame.itertuples(), colours, low, high, strict=True):
            axes.errorbar(row.misfit, y, xerr=[[a], [b]], fmt="o", color=colour, capsize=3)
        axes.axvline(1.0, color=MUTED, ls="--", lw=1)
        axes.text(1.0, len(frame) - 0.55, " expected", fontsize=7, color=MUTED)
        axes.set_yticks(heights, frame.model)
        axes.set_ylim(-0.6, len(frame) - 0.3)
        axes.set_xlim(left=0)
        axes.set_xlabel("misfit on held-out data")


def pairs(table: str | Path, output: str | Path) -> None:
    """Draw pressure drop against flow, and predicted against measured FFR, for each branch of a table model."""
    frame = read_csv(table, ("branch", "flow", "drop_measured", "drop_model_at_flow", "ffr_measured", "ffr_simulated"))
    names = list(dict.fromkeys(frame.branch))
    with saved(output, nrows=2, ncols=len(names), figsize=(3.0 * len(names), 5.4), squeeze=False) as (_, axes):
        for column, name in enumerate(names):
            part = frame[frame.branch == name]
            top, bottom = axes[:, column]
            top.plot(part.flow, part.drop_measured, ".", ms=2, color=MEASURED, label="measured")
            top.plot(part.flow, part.drop_model_at_flow, ".", ms=2, color=BEFORE, label="model at that flow")
            top.set(title=artery(name), xlabel="flow (unit of the table)", ylabel="pressure drop (unit of the table)")
            for key, colour, label in (
                ("ffr_simulated", BEFORE, "unchanged"),
                ("ffr_recalibrated", FLEXIBLE, "recalibrated"),
                ("ffr_repaired", AFTER, "repaired"),
            ):
                bottom.plot(part.ffr_measured, part[key], ".", ms=2, color=colour, label=label)
            ends = [part.ffr_measured.min(), part.ffr_measured.max()]
            bottom.plot(ends, ends, color=MUTED, lw=1)
            bottom.set(xlabel="measured FFR", ylabel="predicted FFR, held-out samples")
        axes[0, 0].legend(fontsize=7, markerscale=4)
        axes[1, 0].legend(fontsize=7, markerscale=4)


def pairs_gap(table: str | Path, output: str | Path) -> None:
    """Draw the error of FFR on held-out samples of each branch of a table model, with 90 % intervals over samples."""
    frame = read_csv(table, ("branch", "ffr_measured", "ffr_simulated", "ffr_recalibrated", "ffr_repaired"))
    models = (
        ("ffr_simulated", MEASURED, "unchanged"),
        ("ffr_recalibrated", BEFORE, "recalibrated"),
        ("ffr_repaired", AFTER, "with the named effects"),
        ("ffr_flexible", FLEXIBLE, "Gaussian process"),
    )
    names = list(dict.fromkeys(frame.branch))
    random = generator(0, "figures", "pairs_gap")
    with saved(output, figsize=(6.0, 0.8 * len(names) + 1.2)) as (_, axes):
        for row, name in enumerate(reversed(names)):
            part = frame[frame.branch == name]
            for step, (key, colour, label) in enumerate(models):
                squared = ((part[key] - part.ffr_measured) ** 2).to_numpy()
                drawn = np.sqrt(squared[random.integers(0, len(squared), (400, len(squared)))].mean(axis=1))
                low, high = np.quantile(drawn, [0.05, 0.95])
                y = row + 0.24 - 0.16 * step
                axes.plot([low, high], [y, y], color=colour, lw=1.5)
                axes.plot(np.sqrt(squared.mean()), y, "o", ms=4, color=colour, label=label if row == 0 else None)
        axes.set_xscale("log")
        axes.set_yticks(range(len(names)), [artery(name) for name in reversed(names)])
        axes.set_ylim(-0.6, len(names) - 0.4)
        axes.set_xlabel("root mean square error of FFR, held-out samples")
        axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))


def pairs_effects(table: str | Path, output: str | Path) -> None:
    """Draw the probability of each effect in the law of each branch of a table model; named ones coloured."""
    frame = read_csv(table, ("branch", "effect", "probability", "named"))
    names, effects = list(dict.fromkeys(frame.branch)), list(dict.fromkeys(frame.effect))[::-1]
    with saved(output, ncols=len(names), figsize=(3.0 * len(names), 2.2), squeeze=False, sharey=True) as (_, axes):
        for axis, name in zip(axes.flat, names, strict=True):
            # Branches list effects by their own probabilities; panels share one list.
            part = frame[frame.branch == name].set_index("effect").reindex(effects)
            colours = [AFTER if chosen is True else MUTED for chosen in part.named.astype(object)]
            axis.barh(range(len(part)), part.probability.fillna(0.0), color=colours)
            axis.set_yticks(range(len(part)), [effect.replace("_", " ") for effect in effects], fontsize=7)
            axis.set_xlim(0, 1)
            axis.set(title=artery(name), xlabel="probability")
