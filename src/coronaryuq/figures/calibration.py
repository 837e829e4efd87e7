"""Cardiac function: what was measured against what the tuned loop gives (paper, Fig. A.1)."""

from coronaryuq.figures.style import MEASURED, SIMULATED, saved
from coronaryuq.files import read_csv


def cardiac_function(fit: str, output: str) -> None:
    """One panel per unit; each target as a pair of bars with its misfit in per cent above."""
    table = read_csv(fit, columns=("target", "description", "unit", "measured", "simulated"))
    groups = list(table.groupby("unit", sort=False))
    widths = [max(len(rows), 2) for _, rows in groups]
    with saved(
        output, ncols=len(groups), figsize=(1.5 + 0.9 * sum(widths), 3.4), width_ratios=widths, squeeze=False
    ) as (
        figure,
        axes,
    ):
        for axis, (unit, rows) in zip(axes[0], groups, strict=True):
            places = range(len(rows))
            axis.bar([x - 0.2 for x in places], rows["measured"], 0.38, color=MEASURED, label="measured")
            axis.bar([x + 0.2 for x in places], rows["simulated"], 0.38, color=SIMULATED, label="tuned model")
            for x, (measured, simulated) in enumerate(zip(rows["measured"], rows["simulated"], strict=True)):
                if measured:
                    text = f"{100 * (simulated / measured - 1):+.1f} %"
                    axis.annotate(text, (x, max(measured, simulated)), ha="center", va="bottom", fontsize=7)
            axis.set_xticks(
                list(places), rows["description"], rotation=40, ha="right", rotation_mode="anchor", fontsize=7
            )
            axis.set_ylabel("ratio" if unit in ("1", "") else unit)
            axis.margins(y=0.12)
        figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
