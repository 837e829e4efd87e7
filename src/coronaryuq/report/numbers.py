"""Numbers with as many digits as their error justifies."""

import numpy as np


def number(value: float | None, digits: int = 3) -> str:
    """Format a number with significant digits, three by default; a dash if there is none."""
    if value is None or not np.isfinite(value):
        return "–"
    return f"{value:.{digits}g}"


def correlation(value: float | None) -> str:
    """Format a correlation with enough decimals to show its distance from one: 0.95, 0.9996."""
    if value is None or not np.isfinite(value):
        return "–"
    distance = max(1 - abs(value), 1e-6)
    return f"{value:.{max(2, 1 - int(np.floor(np.log10(distance))))}f}"


def interval(low: float, high: float) -> tuple[str, str]:
    """Format both ends of an interval with decimals by its width."""
    decimals = max(0, min(6, 1 - int(np.floor(np.log10(high - low))))) if high > low else 3
    return f"{low:.{decimals}f}", f"{high:.{decimals}f}"
