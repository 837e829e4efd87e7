"""The unknown source of flow of a search that names nothing: its waveform under every condition."""

from pathlib import Path

from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.style import saved

COLUMNS = ("condition", "phase", "flow", "low", "high", "vessel")


def flow_source(table: str | Path, output: str | Path) -> None:
    """Draw the flow that leaves at the node, mL/s, over the beat, with its 90 % interval, by condition."""
    frame = read_csv(table, COLUMNS, words=("condition", "vessel"))
    with saved(output, figsize=(7.0, 3.6)) as (_, axes):
        if frame.empty:
            axes.text(0.5, 0.5, "no unknown source was sought, or none explains anything", ha="center")
            axes.set_axis_off()
            return
        for number, (condition, part) in enumerate(frame.groupby("condition", sort=False)):
            colour = f"C{number % 10}"
            axes.fill_between(part["phase"], part["low"], part["high"], color=colour, alpha=0.15, lw=0)
            axes.plot(part["phase"], part["flow"], color=colour, label=condition)
        axes.axhline(0.0, color="0.6", lw=0.6)
        leaves = f"flow that leaves at {frame['vessel'].iloc[0]}\n(mL/s; negative: blood enters)"
        axes.set(xlabel="phase of the beat", ylabel=leaves, xlim=(0.0, 1.0))
        axes.legend(frameon=False, fontsize="small")
