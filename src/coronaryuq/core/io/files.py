"""Files that are whole or absent: written beside their place, then renamed."""

import codecs
import io
import json
import os
import re
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from coronaryuq.core.errors import REMEDIES, InputError

GAPS = ("", "NA", "N/A", "n/a", "#N/A", "NaN", "nan", "-NaN", "-nan", "NULL", "null", "None", "<NA>", "1.#QNAN")
"""What stands in a cell without a number."""


@contextmanager
def replacing(path: str | Path, room: int = 0) -> Iterator[Path]:
    """Give a temporary path in the same folder; on success it takes the place of `path`, on any error it vanishes.

    The temporary keeps the suffix of `path`, because many writers choose their format by it. An OSError while it is
    written names `path`. room: bytes that must be free, asked for first: for writers that a full disk brings down.
    """
    path = Path(path)
    beside = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            if room and hasattr(os, "posix_fallocate"):  # which macOS lacks
                with open(beside, "wb") as reserved:
                    os.posix_fallocate(reserved.fileno(), 0, room)
            yield beside
            with open(beside, "rb") as written:
                os.fsync(written.fileno())
            os.replace(beside, path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        if error.errno not in REMEDIES or error.filename not in (None, str(beside)):
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error


def check_folder(path: str | Path) -> Path:
    """`path`, if results can be written there: asked before long work, and nothing is made. Else an `InputError`."""
    if not str(path):
        raise InputError("command line", "--out", "", "empty; name a folder")
    path = Path(path)
    existing = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
    if not existing.is_dir():
        raise InputError(path, None, None, f"wanted a folder for results, and {existing} is a file")
    try:
        # Root may do everything by the mode, and yet not where the file system is no place for files.
        tempfile.TemporaryFile(dir=existing).close()
    except OSError as error:
        remedy = f"wanted a folder for results, and {existing} takes no files ({error.strerror})"
        raise InputError(path, None, None, remedy) from None
    return path


def check_file(path: str | Path) -> Path:
    """`path`, if a file can be written there: as `check_folder`."""
    path = Path(path)
    if path.is_dir():
        raise InputError(path, None, None, "is a folder; name a file in it")
    check_folder(path.parent)
    return path


def write_text(path: str | Path, text: str) -> None:
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", newline="\n")


def write_json(path: str | Path, value: Any) -> None:
    """Write JSON with floats in their shortest exact form, so that reading gives the same bits back."""
    write_text(path, json.dumps(value, indent=1, ensure_ascii=False, default=_plain) + "\n")


def read_json(path: str | Path, keys: tuple[str, ...] = ()) -> Any:
    """Read JSON; a missing, truncated or malformed file is an `InputError` that names it.

    keys: what must be there; with them, anything but a JSON object is an error too.
    """
    try:
        value = json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file") from None
    except IsADirectoryError:
        raise InputError(path, None, None, "is a folder, wanted a JSON file") from None
    except OSError as error:
        raise InputError(path, None, None, f"cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise InputError(path, None, None, f"not valid JSON ({error}); make it again") from None
    if keys and not isinstance(value, dict):
        raise InputError(path, None, value, f"wanted a JSON object with {', '.join(keys)}; make it again")
    for key in keys:
        if key not in value:
            raise InputError(path, key, None, f"missing; the file has {', '.join(map(str, value))}; make it again")
    return value


def read_npz(path: str | Path, names: tuple[str, ...] = ()) -> dict[str, Any]:
    """Read all arrays of an `.npz`, never a pickle; a broken file or a missing array is an `InputError`."""
    import numpy as np

    try:
        with np.load(path, allow_pickle=False) as held:
            arrays = {name: held[name] for name in held.files}
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file") from None
    except (OSError, ValueError, AttributeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(path, None, None, f"not readable arrays ({error}); delete it and run again") from None
    for name in names:
        if name not in arrays:
            raise InputError(path, name, None, f"array missing; the file has {', '.join(arrays)}; run again")
    return arrays


def read_parquet(path: str | Path, columns: tuple[str, ...] = ()):
    """Read a Parquet table; a broken file or a missing column is an `InputError`."""
    import pandas as pd

    try:
        frame = pd.read_parquet(path)
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file") from None
    except (OSError, ValueError) as error:
        raise InputError(path, None, None, f"not a readable Parquet file ({error}); delete it and run again") from None
    return _with_columns(path, frame, columns)


def read_vtk(path: str | Path):
    """Read a VTK file with pyvista; a missing, empty, truncated or broken one is an `InputError`."""
    import pyvista as pv

    path = Path(path)
    if not path.is_file():
        raise InputError(path, None, None, "no such file")
    # VTK makes an empty mesh of a truncated file, and says so only on its own error channel.
    if path.suffix in (".vtu", ".vtp", ".vti"):
        with open(path, "rb") as opened:
            opened.seek(max(0, path.stat().st_size - 200))
            if b"</VTKFile>" not in opened.read():
                raise InputError(path, None, None, "empty or truncated VTK file; make it again")
    try:
        with pv.VtkErrorCatcher(raise_errors=True, send_to_logging=False):
            data = pv.read(path)
    except Exception as error:
        raise InputError(path, None, None, f"not a readable VTK file ({error})") from None
    if data.n_points == 0:
        raise InputError(path, None, None, "holds no points; make it again")
    return data


def write_vtk(path: str | Path, data) -> None:
    """Write a pyvista data set in the format of the suffix."""
    # VTK aborts the process on a full disk. Compressed and in base64 a file takes 4/3 of the data at most.
    with replacing(path, room=1536 * data.GetActualMemorySize() + 65536) as beside:
        data.save(beside)


def write_csv(path: str | Path, frame) -> None:
    """Write a pandas DataFrame without its index; floats in their shortest exact form."""
    with replacing(path) as beside:
        frame.to_csv(beside, index=False, lineterminator="\n")


def read_csv(path: str | Path, columns: tuple[str, ...] = (), words: tuple[str, ...] = ()):
    """Read a CSV into a DataFrame; a missing file, a broken one or a missing column is an `InputError`.

    Takes what spreadsheets write, too: see `table_text`; with semicolons, decimal commas. words: columns, in lower
    case, of which 01 is no number and NA no gap.
    """
    import pandas as pd

    text, separator = table_text(path)
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
        raise InputError(path, None, None, f"not a readable CSV ({reason})") from None
    if not isinstance(frame.index, pd.RangeIndex):
        # pandas takes the first cells of rows that are longer than the heading for their names.
        raise InputError(path, "heading", None, "rows have more cells than it has columns; see separators")
    return _with_columns(path, frame, columns)


def table_text(path: str | Path) -> tuple[str, str]:
    """Text of a table, and what separates its cells: a comma, semicolon or tab.

    Lines that begin with # are left out, and those of empty cells, as spreadsheets have them below a table.

    UTF-8 with or without a mark, UTF-16 with one, else Windows' Western code page. The first line tells the separator.
    """
    lines, separator = _table_lines(path)
    return "".join(lines.values()), separator


def line_of(path: str | Path, row: int) -> int:
    """Line of the file, from 1, that holds a row of its table, counted from 0 after the heading."""
    lines, _ = _table_lines(path)
    return list(lines)[row + 1]


def _table_lines(path: str | Path) -> tuple[dict[int, str], str]:
    """Line number, from 1, → line, of those that `table_text` keeps; and the separator."""
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
    if re.fullmatch(r"sep=[,;\t]\s*", lines.get(1, "")):  # as Excel writes to itself
        del lines[1]
    first = next((line for line in lines.values() if line.strip()), "")
    separator = next((mark for mark in ",;\t" if mark in first), ",")
    return {n: line for n, line in lines.items() if line.strip(f"{separator} \r\n")}, separator


def _with_columns(path: str | Path, frame, columns: tuple[str, ...]):
    for column in columns:
        if column not in frame.columns:
            raise InputError(path, column, None, f"column missing; the file has {', '.join(map(str, frame.columns))}")
    return frame


def _plain(value: Any) -> Any:
    """JSON form of numpy scalars, arrays and paths."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Path):
        return value.as_posix()
    raise TypeError(f"{type(value).__name__} has no JSON form")
