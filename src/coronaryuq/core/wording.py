"""Wording of sentences: lists, numbers with intervals, p-values."""

from collections.abc import Sequence
from math import ceil, floor, inf, log10


def listed(words: Sequence[str], conjunction: str = "and") -> str:
    """Join words as in a sentence: a, b and c."""
    return f" {conjunction} ".join([", ".join(words[:-1])] * (len(words) > 1) + list(words[-1:]))


def capitalised(text: str) -> str:
    """Return a text with a capital first letter."""
    return text[:1].upper() + text[1:]


def interval_text(value: float, low: float, high: float) -> str:
    """Format a value with its interval, all three to the same decimals: the width has one or two digits."""
    if not 0.0 < high - low < inf:
        text, *ends = (f"{one:.2g}" for one in (value, low, high))
        return f"{text} ({' to '.join(ends)})"
    decimals = ceil(-log10((high - low) / 4.0))
    if max(abs(low), abs(high)) < 1e-3:  # in powers of ten
        power = floor(log10(max(abs(low), abs(high))))
        text, *ends = (f"{one / 10.0**power:.{max(decimals + power, 0)}f}e{power:03d}" for one in (value, low, high))
    else:
        # Zero is added because a negative value may round to -0.
        text, *ends = (f"{round(one, decimals) + 0.0:.{max(decimals, 0)}f}" for one in (value, low, high))
    return f"{text} ({' to '.join(ends)})"


def p_text(p: float) -> str:
    """Format a p-value, including one too small for a float."""
    return f"p = {p:.2g}" if p > 0.0 else "p below 1e-300"
