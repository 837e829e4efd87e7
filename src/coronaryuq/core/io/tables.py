"""Tables and arrays: CSV as spreadsheets write it, Parquet, `.npz`."""

import codecs
import io
import re
import zipfile
import zlib
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import replacing

if TYPE_CHECKING:  # pandas takes a third of a second to import, and the command line imports this module
    import numpy as np
    import pandas as pd

GAPS = ("", "NA", "N/A", "n/a", "#N/A", "NaN", "nan", "-NaN", "-nan", "NULL", "null", "None", "<NA>", "1.#QNAN")
"""Contents of a cell that mean a missing number."""
NAMES = ("name", "vessel", "parent", "bc", "outlet", "label", "location", "place", "branch", "artery", "row", "sample")
"""Columns of names in every table, which may look like numbers or gaps: `001`, `1e3`, `NA`."""
DECIMAL_COMMA = re.compile(r"(?:^|[;\t])\s*[-+]?\d*,\d+\s*(?:[;\t]|$)", re.MULTILINE)
GROUPED = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")
"""1,234: a thousand and more, or a number with three decimals."""
BLOCK = 1 << 20
"""Bytes read at a time."""


def write_csv(path: str | Path, frame: "pd.DataFrame") -> None:
    """Write a table without its index, with floats in their shortest exact form."""
    with replacing(path) as temporary:
        frame.to_csv(temporary, index=False, lineterminator="\n")


def read_csv(path: str | Path, columns: tuple[str, ...] = (), words: tuple[str, ...] = ()) -> "pd.DataFrame":
    """Read a CSV file, also as spreadsheets write it (see `read_table_text`).

    Parameters
    ----------
    path
        The file. Decimal commas are understood where semicolons or tabs separate the cells.
    columns
        Required columns. If one is missing, all headings are taken in lower case and without blanks around them.
    words
        Further columns of text than `NAMES`, in lower case: there `01` is not a number and `NA` not a gap.

    Raises
    ------
    InputError
        If the file is missing or malformed, a column is missing or given twice, or rows are longer than the header.
    """
    import pandas as pd

    separator = _separator(path)
    comma = has_decimal_commas(path)
    try:
        layout: dict[str, Any] = {
            "sep": separator,
            "decimal": "," if comma else ".",
            "skipinitialspace": separator != "\t",
        }
        written = list(pd.read_csv(TableText(path), nrows=1, header=None, dtype=str, **layout).iloc[0].fillna(""))
        _check_heading(path, written)
        heading = list(pd.read_csv(TableText(path), nrows=0, **layout).columns)
        kept = {name: str for name in heading if str(name).strip().lower() in (*words, *NAMES)}
        blank = {name: [""] for name in kept if str(name).strip().lower() not in words}
        layout |= {"keep_default_na": False, "na_values": {name: list(GAPS) for name in heading if name not in kept}}
        layout["na_values"] |= blank
        frame = pd.read_csv(TableText(path), dtype=kept, **layout)
        for name in kept:
            frame[name] = frame[name].str.strip()
    except InputError:
        raise
    except pd.errors.EmptyDataError:
        raise InputError(path, None, None, "is empty; expected a heading and rows") from None
    except ValueError as error:
        raise _unreadable(path, " ".join(str(error).split())) from None
    if not isinstance(frame.index, pd.RangeIndex):
        # If rows are longer than the header, pandas takes their first cells for an index.
        remedy = "more cells than the heading; check the separators (decimal commas need semicolons between the cells)"
        raise InputError(path, f"line {line_number(path, 0)}", None, remedy)
    # A spreadsheet writes blank columns where cells were cleared.
    unnamed = [name for name, given in zip(frame.columns, written, strict=False) if not str(given).strip()]
    frame = frame.drop(columns=[name for name in unnamed if frame[name].replace("", None).isna().all()])
    return _with_columns(path, frame, columns)


def has_decimal_commas(path: str | Path) -> bool:
    """Return whether the numbers of a table have decimal commas, which a table separated by commas never has.

    Raises
    ------
    InputError
        If the commas may as well separate thousands: a column has 1,234 beside whole numbers, and the table has no
        other number with a comma.
    """
    separator = _separator(path)
    doubtful: dict[int, tuple[int, str]] = {}
    whole: set[int] = set()
    for number, line in _table_lines(path) if separator != "," else ():
        for column, cell in enumerate(part.strip(' "\r\n') for part in line.split(separator)):
            if GROUPED.fullmatch(cell):
                doubtful.setdefault(column, (number, cell))
            elif re.fullmatch(r"[-+]?\d*,\d+", cell):
                return True
            elif cell.lstrip("+-").isdecimal():
                whole.add(column)
    for column in sorted(whole & set(doubtful)):
        number, cell = doubtful[column]
        plain, point = cell.replace(",", ""), cell.replace(",", ".")
        raise InputError(path, f"line {number}", cell, f"a decimal comma, or thousands? write {point} or {plain}")
    return bool(doubtful)


def read_table_text(path: str | Path) -> tuple[str, str]:
    """Return the text of a table and its cell separator, which its first line decides: comma, semicolon or tab.

    Lines that begin with # and lines of empty cells (spreadsheets leave them below a table) are dropped. The encoding
    is UTF-8 with or without a byte-order mark, UTF-16 with one, else Windows' Western code page.
    """
    return "".join(line for _, line in _table_lines(path)), _separator(path)


def line_number(path: str | Path, row: int) -> int:
    """Return the line number, from 1, of a row of a table, counted from 0 after the header."""
    number, _ = next(islice(_table_lines(path), row + 1, None))
    return number


class TableText(io.TextIOBase):
    """The lines that `read_table_text` keeps as a file, of which no more is in memory than was asked for."""

    def __init__(self, path: str | Path):
        self._lines, self._left = _table_lines(path), ""

    def readable(self) -> bool:
        return True

    def read(self, size: int | None = -1) -> str:
        """Return up to `size` characters, all that are left if that is negative."""
        parts, held, most = [self._left], len(self._left), float("inf") if size is None or size < 0 else size
        while held < most and (line := next(self._lines, None)) is not None:
            parts.append(line[1])
            held += len(line[1])
        text = "".join(parts)
        text, self._left = (text, "") if held <= most else (text[:size], text[size:])
        return text


def _table_lines(path: str | Path) -> Iterator[tuple[int, str]]:
    """Yield the lines that `read_table_text` keeps, with their numbers from 1."""
    blank = f"{_separator(path)} \r\n"
    return ((number, line) for number, line in _written_lines(path) if line.strip(blank))


def _separator(path: str | Path) -> str:
    first = next((line for _, line in _written_lines(path) if line.strip()), "")
    for mark in ";\t":  # without a heading, the first comma may belong to a number
        if mark in first and DECIMAL_COMMA.search(first):
            return mark
    return next((mark for mark in ",;\t" if mark in first), ",")


def _written_lines(path: str | Path) -> Iterator[tuple[int, str]]:
    """Yield all lines but comments and Excel's own separator line, with their numbers from 1."""
    encoding = _encoding(path)
    with open(path, encoding=encoding, errors="replace" if encoding == "cp1252" else "strict", newline="") as file:
        parts = (part for line in file for part in line.splitlines(keepends=True))
        for number, line in enumerate(parts, 1):
            if not line.startswith("#") and not (number == 1 and re.fullmatch(r"sep=[,;\t]\s*", line)):
                yield number, line


def _encoding(path: str | Path) -> str:
    """Return UTF-16 for a file that begins with its mark, UTF-8 if the whole file can be that, else Windows' page."""
    try:
        with open(path, "rb") as file:
            start = file.read(2)
            encoding = "utf-16" if start in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else "utf-8-sig"
            decoder, block = codecs.getincrementaldecoder(encoding)(), start
            while block:
                decoder.decode(block)
                block = file.read(BLOCK)
            decoder.decode(b"", final=True)
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file") from None
    except IsADirectoryError:
        raise InputError(path, None, None, "is a folder; name a file") from None
    except OSError as error:
        raise InputError(path, None, None, f"cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        encoding = "cp1252"
    if start == b"PK":
        raise InputError(path, None, None, "a spreadsheet (xlsx or ods), not a text file; save it as CSV")
    if encoding != "utf-16" and b"\0" in start:
        raise InputError(path, None, None, "not a text file; if it is UTF-16, save it in the encoding UTF-8")
    return encoding


def read_parquet(path: str | Path, columns: tuple[str, ...] = ()) -> "pd.DataFrame":
    """Read a Parquet table; raise `InputError` for a broken file or a missing column."""
    import pandas as pd

    try:
        frame = pd.read_parquet(path)
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file") from None
    except (OSError, ValueError) as error:
        raise InputError(path, None, None, f"not a readable Parquet file ({error}); delete it and run again") from None
    return _with_columns(path, frame, columns)


def read_npz(path: str | Path, names: tuple[str, ...] = ()) -> "dict[str, np.ndarray]":
    """Read all arrays of an `.npz`, never a pickle; raise `InputError` for a broken file or a missing array."""
    import numpy as np

    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file") from None
    except (OSError, ValueError, AttributeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(path, None, None, f"not readable arrays ({error}); delete it and run again") from None
    for name in names:
        if name not in arrays:
            raise InputError(path, name, None, f"array missing; the file has {', '.join(arrays)}; run again")
    return arrays


def write_npz(path: str | Path, arrays: dict[str, Any]) -> None:
    """Write named arrays as `.npz`."""
    import numpy as np

    with replacing(path) as beside, open(beside, "wb") as out:
        np.savez(out, **arrays)


def _check_heading(path: str | Path, heading: list[str]) -> None:
    """Raise `InputError` if two columns have the same name: which of them would be meant?"""
    names = [str(name).strip() for name in heading]
    for name in names:
        if name and names.count(name) > 1:
            number = re.fullmatch(r"[-+]?[\d.,]+(?:[eE][-+]?\d+)?", name)
            remedy = "expected a heading with the names of the columns" if number else "column given twice; keep one"
            raise InputError(path, "line 1" if number else name, ", ".join(names) if number else None, remedy)


def _unreadable(path: str | Path, reason: str) -> InputError:
    """Return what pandas says of a malformed table in the words of its user."""
    if longer := re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", reason):
        wanted, row, cells = map(int, longer.groups())
        remedy = f"has {cells} cells, but the heading {wanted}; check the separators, and quote text that has one"
        return InputError(path, f"line {line_number(path, row - 2)}", None, remedy)
    if opened := re.search(r"EOF inside string starting at row (\d+)", reason):
        line = line_number(path, int(opened[1]) - 1)
        return InputError(path, f"line {line}", None, "a quotation mark is opened and never closed")
    return InputError(path, None, None, f"not a readable CSV file ({reason})")


def _with_columns(path: str | Path, frame: "pd.DataFrame", columns: tuple[str, ...]) -> "pd.DataFrame":
    if not set(columns) <= set(frame.columns):
        plain = [str(column).strip().lower() for column in frame.columns]
        if set(columns) <= set(plain) and len(set(plain)) == len(plain):
            return frame.set_axis(plain, axis=1)
    for column in columns:
        spellings = [str(name) for name in frame.columns if str(name).strip().lower() == column.lower()]
        if len(spellings) > 1:
            raise InputError(path, column, ", ".join(spellings), "column given twice; keep one")
        if column not in frame.columns:
            near = next((c for c in map(str, frame.columns) if re.match(rf"{re.escape(column)}\W", c, re.I)), None)
            remedy = f"; rename {near!r} to {column}, in the unit asked for" if near else ""
            has = ", ".join(map(str, frame.columns))
            raise InputError(path, column, None, f"column missing; the file has {has}{remedy}")
    return frame
