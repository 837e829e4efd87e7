"""Wrong input, and results that cannot be written: one line with the place of the fault and a remedy."""

import difflib
import errno
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

Word = TypeVar("Word", bound=str)

REMEDIES = {
    errno.ENOSPC: "free some space there and run again",
    errno.EDQUOT: "your disk quota there is exhausted; free some space and run again",
    errno.EACCES: "change its permissions, or name a folder that you can write to",
    errno.EPERM: "change its permissions, or name a folder that you can write to",
    errno.EROFS: "name a folder elsewhere",
}
"""Remedy for each reason why the operating system cannot write a file."""


class InputError(ValueError):
    """Wrong input, reported on one line as `file: field = value: remedy`.

    The command line prints the line and exits with `EXIT_CODE`; nothing has been written by then.

    Parameters
    ----------
    file
        The file at fault, or the option of the command line.
    field
        What is wrong inside the file; None if it is the whole file (missing, truncated, of another format).
    value
        The value at fault; None if there is none to show.
    remedy
        What is wrong and what to do about it.
    """

    EXIT_CODE = 2

    def __init__(self, file: str | Path, field: str | None, value: Any, remedy: str):
        self.file, self.field, self.value, self.remedy = str(file), field, value, remedy
        super().__init__(str(self))

    def __str__(self) -> str:
        where = self.file if self.field is None else f"{self.file}: {self.field}"
        shown = "" if self.value is None else f" = {_shorten(self.value)}"
        return " ".join(f"{where}{shown}: {self.remedy}".split())

    def __reduce__(self):
        return type(self), (self.file, self.field, self.value, self.remedy)


def os_error_line(error: OSError) -> str | None:
    """Return `file: reason: remedy` if the operating system cannot write a file, else None."""
    if error.errno not in REMEDIES:
        return None
    # A finished file is renamed: the user knows the second name.
    file = error.filename2 or error.filename
    where = "" if file is None else f"{os.fspath(file)}: "
    return " ".join(f"{where}{os.strerror(error.errno)}: {REMEDIES[error.errno]}".split())


def meant(written: Any, known: Iterable[Word], others: Mapping[str, Word] | None = None) -> Word | None:
    """Return the known word that a text means; capitals and blanks do not matter. None if there is none.

    others: further words for a known one, in lower case without blanks.
    """
    plain = "".join(str(written).split()).lower()
    return next((word for word in known if word.lower() == plain), (others or {}).get(plain))


def similar(name: Any, known: Iterable[str]) -> str:
    """Return "similar: X, Y" for up to three words that resemble a name, whatever their capitals, else nothing.

    First comes one with the same two parts in the other order, as "B:A" for "A:B".
    """
    known = list(known)
    turned = ":".join(reversed(str(name).split(":"))).lower()
    found = [word for word in known if word.lower() == turned and ":" in turned]
    found = list(dict.fromkeys([*found, *_close(name, known, 3, 0.3)]))[:3]
    return f"similar: {', '.join(found)}" if found else ""


def nearest(name: Any, known: Iterable[str]) -> str:
    """Return "did you mean X? " for a word that resembles a known one, else an empty string."""
    found = _close(name, known, 1, 0.6)
    return f"did you mean {found[0]}? " if found else ""


def _close(name: Any, known: Iterable[str], count: int, cutoff: float) -> list[str]:
    by_lower = {word.lower(): word for word in known}
    return [by_lower[word] for word in difflib.get_close_matches(str(name).lower(), by_lower, n=count, cutoff=cutoff)]


def _shorten(value: Any, limit: int = 80) -> str:
    text = repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."
