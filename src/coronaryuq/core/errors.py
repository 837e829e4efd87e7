"""What the user gave is wrong, or what was made cannot be written: one line that says where and what to do about it."""

import errno
import os
from pathlib import Path
from typing import Any

REMEDIES = {
    errno.ENOSPC: "make room there and run again",
    errno.EDQUOT: "your quota there is used up: make room and run again",
    errno.EACCES: "change its rights, or name a folder in which you may write",
    errno.EPERM: "change its rights, or name a folder in which you may write",
    errno.EROFS: "name a folder elsewhere",
}
"""What to do about an operating system's refusal to write."""


class InputError(ValueError):
    """Wrong input, reported as `file: field = value: remedy` on one line.

    `field` and `value` may be None when the whole file is at fault (missing, truncated, of another format).
    The command line prints the line and exits with `EXIT_CODE`; nothing has been written by then.
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


def refusal(error: OSError) -> str | None:
    """`file: reason: remedy` on one line, where the operating system will not write a file; else None."""
    if error.errno not in REMEDIES:
        return None
    # A finished file is renamed: what the user named is the second of the two.
    file = error.filename2 or error.filename
    where = "" if file is None else f"{os.fspath(file)}: "
    return " ".join(f"{where}{os.strerror(error.errno)}: {REMEDIES[error.errno]}".split())


def _shorten(value: Any, limit: int = 80) -> str:
    text = repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."
