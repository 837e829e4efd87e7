"""Numbers as a reader wants them: as many digits as their error deserves."""

import numpy as np


def number(value: float | None, digits: int = 3) -> str:
    """A number for a reader: three significant digits, a dash where there is none."""
    if value is None or not np.isfinite(value):
        return "–"
    return f"{value:.{digits}g}"


def correlation(value: float | None) -> str:
    """A correlation with as many nines as it has: 0.95, 0.9996."""
    if value is None or not np.isfinite(value):
        return "–"
    short_of_one = max(1 - abs(value), 1e-6)
    return f"{value:.{max(2, 1 - int(np.floor(np.log10(short_of_one))))}f}"


def interval(low: float, high: float) -> tuple[str, str]:
    """Both ends with as many decimals as their distance deserves."""
    decimals = max(0, min(6, 1 - int(np.floor(np.log10(high - low))))) if high > low else 3
    return f"{low:.{decimals}f}", f"{high:.{decimals}f}"
