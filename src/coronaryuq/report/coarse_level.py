"""Cost and gain of a coarse 3D level, in a sentence for the report."""

from coronaryuq.estimation.results import CoarseLevel, RowReport


def sentence(rows: list[RowReport], coarse: CoarseLevel | None) -> str:
    """Return the sentence for the content of `estimates.json`; empty without a coarse level."""
    if coarse is None:
        return ""
    gains: dict[str, float] = {}
    for row in rows:
        if row.row in coarse.rows:
            quantity, _, branch = (row.label.split(", ") + ["", ""])[:3]
            gain = coarse.rows[row.row].gain
            # Rows of one 3D quantity differ in their estimator without the level; the level must improve on the one
            # with the smallest standard error.
            name = f"{quantity} {branch}".strip()
            gains[name] = min(gain, gains.get(name, gain))
    failed = f", {coarse.failed} of them failed" if coarse.failed else ""
    paid = ", ".join(f"{name} ({gain:.2g})" for name, gain in gains.items() if gain > 1)
    lost = ", ".join(f"{name} ({gain:.2g})" for name, gain in gains.items() if gain <= 1)
    return (
        f"Coarse 3D level: {coarse.runs} runs of {coarse.coarse_cpu_s:.2g} CPU-s each{failed}; a fine run took "
        f"{coarse.fine_cpu_s:.2g} CPU-s. It reduced the cost-weighted variance (ratio without/with the level) for "
        f"{paid or 'no quantity'}" + (f", but not for {lost}." if lost else ".")
    )
