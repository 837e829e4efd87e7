"""Wording of sentences: lists, numbers with intervals, p-values."""

from collections.abc import Sequence


def listed(words: Sequence[str]) -> str:
    """Join words as in a sentence: a, b and c."""
    return " and ".join([", ".join(words[:-1])] * (len(words) > 1) + list(words[-1:]))


def capitalised(text: str) -> str:
    """Return a text with a capital first letter."""
    return text[:1].upper() + text[1:]


def interval_text(value: float, low: float, high: float) -> str:
    """Format a value with its interval, to two digits or as many as tell the ends from the value, if they differ."""
    for digits in range(2, 7):
        text, *ends = (f"{one:.{digits}g}" for one in (value, low, high))
        if text not in ends or value in (low, high):
            break
    return f"{text} ({' to '.join(ends)})"


def p_text(p: float) -> str:
    """Format a p-value, including one too small for a float."""
    return f"p = {p:.2g}" if p > 0.0 else "p below 1e-300"
