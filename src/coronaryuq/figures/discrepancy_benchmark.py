"""What was hidden on purpose and what was named, from the tables of the benchmark `discrepancy`."""

import numpy as np

from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.style import ESTIMATORS, saved

COLOURS = [ESTIMATORS[name] for name in ("MFMC", "MFMC-AE", "multilevel", "BLUE", "best", "MC")]


def discovery(shares: str, answers: str, output: str) -> None:
    """Left: cases of the first network by what was hidden and what was named first. Right: shares of all networks."""
    table = read_csv(shares, columns=("tested", "on", "share", "low", "high", "wanted_from", "wanted_to"))
    named = read_csv(answers, columns=("network", "hidden", "named", "cases"))
    first = named["network"].iloc[0]
    height = max(4.5, 1.8 + 0.22 * named.loc[named["network"] == first, "hidden"].nunique())
    with saved(output, ncols=2, figsize=(12.5, height), width_ratios=(2.1, 1)) as (_, (left, side)):
        _confusion(left, named[named["network"] == first], f"{first}: cases by what was hidden and what was named")
        _shares(side, table)


def _confusion(axes, named, title: str) -> None:
    hidden = list(dict.fromkeys(named["hidden"]))
    others = [name for name in dict.fromkeys(named["named"]) if name not in hidden and name != "outside"]
    answers = [name for name in hidden if name in set(named["named"])] + others
    answers += ["outside"] * ("outside" in set(named["named"]))
    counts = np.zeros((len(hidden), len(answers)), dtype=int)
    for row in named.itertuples():
        counts[hidden.index(row.hidden), answers.index(row.named)] = row.cases
    axes.imshow(counts / counts.sum(axis=1, keepdims=True), cmap="Blues", aspect="auto", vmin=0, vmax=1)
    for (row, column), count in np.ndenumerate(counts):
        if count:
            dark = count > 0.5 * counts[row].sum()
            axes.text(column, row, count, ha="center", va="center", fontsize=8, color="w" if dark else "k")
    axes.set_xticks(range(len(answers)), list(map(words, answers)), rotation=60, ha="right", fontsize=8)
    axes.set_yticks(range(len(hidden)), list(map(words, hidden)), fontsize=8)
    axes.set(xlabel="named first", ylabel="hidden", title=title)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _shares(axes, table) -> None:
    tested, networks = list(dict.fromkeys(table["tested"])), list(dict.fromkeys(table["on"]))
    apart = min(0.15, 0.7 / len(networks))
    labelled = set()
    for one in table.itertuples():
        row, number = tested.index(one.tested), networks.index(one.on)
        at, colour = row + apart * (number - 2 if len(networks) > 2 else number), COLOURS[number % len(COLOURS)]
        axes.plot([one.low, one.high], [at, at], color=colour, lw=1.5)
        axes.plot(one.share, at, "o", color=colour, ms=4, label=None if one.on in labelled else one.on)
        labelled.add(one.on)
    for row, name in enumerate(tested):
        wanted = table[table["tested"] == name].iloc[0]
        axes.barh(row, wanted.wanted_to - wanted.wanted_from, 0.8, wanted.wanted_from, color="0.88", zorder=0)
        axes.text(0.5, row - 0.46, name, ha="center", va="bottom", fontsize=8)
    axes.set(xlabel="share, 95 % interval; grey: wanted", xlim=(-0.02, 1.02), yticks=[])
    axes.set_ylim(len(tested) - 0.4, -0.8)
    axes.spines["left"].set_visible(False)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.06), ncols=2, fontsize=8)


def words(effect: str) -> str:
    """A cell's label as a reader takes it."""
    return effect.replace("outside:", "outside: ").replace("+", " + ").replace("_", " ")
