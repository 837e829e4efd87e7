"""What the data of the figures say, for readers who do not see them."""

from collections.abc import Mapping, Sequence

from coronaryuq.estimation.results import RowReport
from coronaryuq.posterior.results import Summary
from coronaryuq.report.quantities import FFR, Digits, kind_of


def alternatives(
    rows: Sequence[RowReport], lowest: Mapping[str, str], summary: Summary, names: Mapping[str, str]
) -> dict[str, str]:
    """Return what the data of some figures say, by the figure's name.

    Parameters
    ----------
    rows
        Rows of `estimates.json`.
    lowest
        Lowest FFR of the tree.
    summary
        `posterior/summary.json`.
    names
        What a reader calls the inputs.
    """
    ffr = [row for row in rows if row.column_3d.startswith(FFR)]
    shear, extremes = (
        [row for row in rows if kind_of(row.column_3d).shear and kind_of(row.column_3d).extreme == extreme]
        for extreme in (False, True)
    )
    medians = [f"{names.get(name, name)} {one.median:.2f}" for name, one in summary.multipliers.items()]
    texts = {
        "intervals_ffr": f"Mean of FFR by estimator: {_quoted(ffr, rows)}.",
        "intervals_wss": f"Means of wall shear: {_quoted(shear, rows)}.",
        "intervals_extremes": f"Means of extremes of wall shear: {_quoted(extremes, rows)}.",
        "marginals": f"Median resistance over its tuned value: {', '.join(medians)}.",
        "chains": f"Ranks of {summary.chains} chains; largest R-hat {summary.rhat_max:.3f}, of "
        f"{names.get(summary.worst_parameter, summary.worst_parameter)}.",
        "flows": f"{100 * summary.predictive.coverage_95:.0f} % of the target flows lie within the central 95 % of the "
        "simulated ones.",
    }
    if lowest:
        texts["tree_ffr"] = f"FFR along the tree: lowest {lowest['ffr']}, {lowest['where']}."
    return texts


def _quoted(rows: Sequence[RowReport], every: Sequence[RowReport]) -> str:
    """Return the recommended estimate of each row in words."""
    words = []
    for row in rows:
        digits, (_, paired, branch) = Digits(row.column_3d, every), (row.label.split(", ") + ["", ""])[:3]
        value = row.recommended_report
        words.append(f"{kind_of(row.column_3d).heading} {branch} with 0D {paired} {digits(value.mean)}")
    return ", ".join(words)
