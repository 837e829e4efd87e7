"""What a coarse 3D level cost and what it gained, in a sentence for the report."""

from coronaryuq.estimation.results import CoarseLevel, RowReport


def sentence(rows: list[RowReport], coarse: CoarseLevel | None) -> str:
    """Say what `estimates.json` holds of the coarse level; empty without one."""
    if coarse is None:
        return ""
    gains: dict[str, float] = {}
    for row in rows:
        if row.row in coarse.rows:
            quantity, _, branch = (row.label.split(", ") + ["", ""])[:3]
            gain = coarse.rows[row.row].gain
            # Rows of one 3D quantity differ in what stands without the level: the best of them is what it has to beat.
            name = f"{quantity} {branch}".strip()
            gains[name] = min(gain, gains.get(name, gain))
    failed = f", {coarse.failed} of them failed" if coarse.failed else ""
    paid = ", ".join(f"{name} ({gain:.2g})" for name, gain in gains.items() if gain > 1)
    lost = ", ".join(f"{name} ({gain:.2g})" for name, gain in gains.items() if gain <= 1)
    return (
        f"Coarse 3D level: {coarse.runs} runs at {coarse.coarse_cpu_s:.2g} CPU-s{failed}; a fine run took "
        f"{coarse.fine_cpu_s:.2g} CPU-s. By variance times cost, without the level over with it, it paid for "
        f"{paid or 'nothing'}" + (f" and did not for {lost}." if lost else ".")
    )
