"""What the user gave is wrong: one line that says where and what to do about it."""

from pathlib import Path
from typing import Any


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


def _shorten(value: Any, limit: int = 80) -> str:
    text = repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."
