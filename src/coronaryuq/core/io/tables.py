"""Tables and arrays: CSV as spreadsheets write it, Parquet, `.npz`."""

import codecs
import io
import re
import zipfile
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import replacing

if TYPE_CHECKING:  # pandas takes a third of a second to import, and the command line imports this module
    import numpy as np
    import pandas as pd

GAPS = ("", "NA", "N/A", "n/a", "#N/A", "NaN", "nan", "-NaN", "-nan", "NULL", "null", "None", "<NA>", "1.#QNAN")
"""Contents of a cell that mean a missing number."""


def write_csv(path: str | Path, frame: "pd.DataFrame") -> None:
    """Write a table without its index, with floats in their shortest exact form."""
    with replacing(path) as temporary:
        frame.to_csv(temporary, index=False, lineterminator="\n")


def read_csv(path: str | Path, columns: tuple[str, ...] = (), words: tuple[str, ...] = ()) -> "pd.DataFrame":
    """Read a CSV file, also as spreadsheets write it (see `read_table_text`).

    Parameters
    ----------
    path
        The file. Decimal commas are understood where semicolons separate the cells.
    columns
        Required columns.
    words
        Columns of text, in lower case: there `01` is not a number and `NA` not a gap.

    Raises
    ------
    InputError
        If the file is missing or malformed, a column is missing, or rows are longer than the header.
    """
    import pandas as pd

    text, separator = read_table_text(path)
    decimal = "," if separator == ";" and re.search(r"(?:^|;)\s*[-+]?\d*,\d+\s*(?:;|$)", text, re.MULTILINE) else "."
    try:
        layout = {"sep": separator, "decimal": decimal, "skipinitialspace": separator != "\t"}
        heading = pd.read_csv(io.StringIO(text), nrows=0, **layout).columns
        kept = {name: str for name in heading if str(name).strip().lower() in words}
        if kept:
            layout |= {"keep_default_na": False, "na_values": {name: GAPS for name in heading if name not in kept}}
        frame = pd.read_csv(io.StringIO(text), dtype=kept, **layout)
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise InputError(path, None, None, f"not a readable CSV file ({reason})") from None
    if not isinstance(frame.index, pd.RangeIndex):
        # If rows are longer than the header, pandas takes their first cells for an index.
        raise InputError(path, "heading", None, "some rows have more cells than the heading; check the separators")
    return _with_columns(path, frame, columns)


def read_table_text(path: str | Path) -> tuple[str, str]:
    """Return the text of a table and its cell separator, which its first line decides: comma, semicolon or tab.

    Lines that begin with # and lines of empty cells (spreadsheets leave them below a table) are dropped. The encoding
    is UTF-8 with or without a byte-order mark, UTF-16 with one, else Windows' Western code page.
    """
    lines, separator = _table_lines(path)
    return "".join(lines.values()), separator


def line_number(path: str | Path, row: int) -> int:
    """Return the line number, from 1, of a row of a table, counted from 0 after the header."""
    lines, _ = _table_lines(path)
    return list(lines)[row + 1]


def _table_lines(path: str | Path) -> tuple[dict[int, str], str]:
    """Return the lines that `read_table_text` keeps, by their number from 1, and the separator."""
    try:
        raw = Path(path).read_bytes()
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file") from None
    except OSError as error:
        raise InputError(path, None, None, f"cannot be read ({error.strerror})") from None
    try:
        text = raw.decode("utf-16" if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("cp1252", errors="replace")
    lines = {n: line for n, line in enumerate(text.splitlines(keepends=True), 1) if not line.startswith("#")}
    if re.fullmatch(r"sep=[,;\t]\s*", lines.get(1, "")):  # Excel's own separator line
        del lines[1]
    first = next((line for line in lines.values() if line.strip()), "")
    separator = next((mark for mark in ",;\t" if mark in first), ",")
    return {n: line for n, line in lines.items() if line.strip(f"{separator} \r\n")}, separator


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


def _with_columns(path: str | Path, frame: "pd.DataFrame", columns: tuple[str, ...]) -> "pd.DataFrame":
    for column in columns:
        if column not in frame.columns:
            raise InputError(path, column, None, f"column missing; the file has {', '.join(map(str, frame.columns))}")
    return frame
