"""Hidden effects and the answers to them, from the tables of the benchmark `discrepancy`."""

import numpy as np

from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.style import ESTIMATORS, saved

COLOURS = [ESTIMATORS[name] for name in ("MFMC", "MFMC-AE", "multilevel", "BLUE", "crossfit-GP", "MC")]


def hidden_effects(shares: str, answers: str, output: str) -> None:
    """Draw cases of the first network by hidden effect and first answer (left), and all fractions correct (right)."""
    table = read_csv(shares, columns=("tested", "on", "fraction", "low", "high", "target_from", "target_to"))
    answered = read_csv(answers, columns=("network", "hidden", "named", "cases"))
    first = answered["network"].iloc[0]
    height = max(4.5, 1.8 + 0.22 * answered.loc[answered["network"] == first, "hidden"].nunique())
    with saved(output, ncols=2, figsize=(12.5, height), width_ratios=(2.1, 1)) as (_, (left, right)):
        _confusion(left, answered[answered["network"] == first], f"{first}: cases by hidden effect and first answer")
        _shares(right, table)


def _confusion(axes, answered, title: str) -> None:
    hidden = list(dict.fromkeys(answered["hidden"]))
    others = [name for name in dict.fromkeys(answered["named"]) if name not in hidden and name != "outside"]
    answers = [name for name in hidden if name in set(answered["named"])] + others
    answers += ["outside"] * ("outside" in set(answered["named"]))
    counts = np.zeros((len(hidden), len(answers)), dtype=int)
    for row in answered.itertuples():
        counts[hidden.index(row.hidden), answers.index(row.named)] = row.cases
    axes.imshow(counts / counts.sum(axis=1, keepdims=True), cmap="Blues", aspect="auto", vmin=0, vmax=1)
    for (row, column), count in np.ndenumerate(counts):
        if count:
            dark = count > 0.5 * counts[row].sum()
            # As wide as two digits at most: white ones beyond the cell would be lost on its pale surroundings.
            size = 8 * min(1.0, 2.5 / len(str(count)))
            axes.text(column, row, count, ha="center", va="center", fontsize=size, color="w" if dark else "k")
    axes.set_xticks(range(len(answers)), list(map(cell_label, answers)), rotation=60, ha="right", fontsize=8)
    axes.set_yticks(range(len(hidden)), list(map(cell_label, hidden)), fontsize=8)
    axes.set(xlabel="first answer", ylabel="hidden effect", title=title)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _shares(axes, table) -> None:
    tested, networks = list(dict.fromkeys(table["tested"])), list(dict.fromkeys(table["on"]))
    apart = min(0.15, 0.7 / len(networks))
    labelled = set()
    for share in table.itertuples():
        row, number = tested.index(share.tested), networks.index(share.on)
        y, colour = row + apart * (number - 2 if len(networks) > 2 else number), COLOURS[number % len(COLOURS)]
        axes.plot([share.low, share.high], [y, y], color=colour, lw=1.5)
        axes.plot(share.fraction, y, "o", color=colour, ms=4, label=None if share.on in labelled else share.on)
        labelled.add(share.on)
    for row, name in enumerate(tested):
        target = table[table["tested"] == name].iloc[0]
        axes.barh(row, target.target_to - target.target_from, 0.8, target.target_from, color="0.88", zorder=0)
        axes.text(0.5, row - 0.46, name, ha="center", va="bottom", fontsize=8)
    axes.set(xlabel="fraction, 95 % interval; grey: target", xlim=(-0.02, 1.02), yticks=[])
    axes.set_ylim(len(tested) - 0.4, -0.8)
    axes.spines["left"].set_visible(False)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.06), ncols=2, fontsize=8)


def cell_label(effect: str) -> str:
    """Return the label of a hidden effect, or of an answer, for readers."""
    special = {"none": "nothing", "outside": "something else"}
    return special.get(effect) or effect.replace("outside:", "outside: ").replace("+", " + ").replace("_", " ")
