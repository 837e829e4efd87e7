"""Right answers of several methods on the same hidden effects, from the table of the benchmark `discrepancy`."""

import numpy as np

from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.style import ESTIMATORS, saved

COLOURS = [ESTIMATORS[name] for name in ("MC", "MFMC", "multilevel", "crossfit-GP", "BLUE", "MFMC-AE")]


def rivals(outcomes: str, output: str) -> None:
    """Draw the share of right answers of every method, with its interval, for each group of cases."""
    table = read_csv(outcomes, columns=("group", "method", "cases", "share", "low", "high"))
    groups, methods = list(dict.fromkeys(table["group"])), list(dict.fromkeys(table["method"]))
    width = 0.84 / len(methods)
    with saved(output, figsize=(10.0, 4.6)) as (_, axes):
        for number, method in enumerate(methods):
            mine = table[table["method"] == method].set_index("group").loc[groups]
            x = np.arange(len(groups)) + width * (number - (len(methods) - 1) / 2)
            spread = np.maximum([mine["share"] - mine["low"], mine["high"] - mine["share"]], 0.0)
            error = {"ecolor": "0.45", "elinewidth": 1.0}
            axes.bar(x, mine["share"], 0.92 * width, yerr=spread, color=COLOURS[number], label=method, error_kw=error)
        counts = table.drop_duplicates("group").set_index("group")["cases"]
        labels = ["\n".join([*group.split(", "), f"({counts[group]} cases)"]) for group in groups]
        axes.set_xticks(range(len(groups)), labels)
        axes.set(ylim=(0.0, 1.02), ylabel="right answers, 95 % interval")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=3)
