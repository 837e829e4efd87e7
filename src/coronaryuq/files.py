"""Files that are whole or absent: written beside their place, then renamed."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from coronaryuq.errors import InputError


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a temporary path in the same folder; on success it takes the place of `path`, on any error it vanishes.

    The temporary keeps the suffix of `path`, because many writers choose their format by it.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield beside
        with open(beside, "rb") as written:
            os.fsync(written.fileno())
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", newline="\n")


def write_json(path: str | Path, value: Any) -> None:
    """Write JSON with floats in their shortest exact form, so that reading gives the same bits back."""
    write_text(path, json.dumps(value, indent=1, ensure_ascii=False, default=_plain) + "\n")


def read_json(path: str | Path) -> Any:
    """Read JSON; a missing, truncated or malformed file is an `InputError` that names it."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file") from None
    except IsADirectoryError:
        raise InputError(path, None, None, "is a folder, wanted a JSON file") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(path, None, None, f"not valid JSON ({error}); make it again") from None


def write_csv(path: str | Path, frame) -> None:
    """Write a pandas DataFrame without its index; floats in their shortest exact form."""
    with replacing(path) as beside:
        frame.to_csv(beside, index=False, lineterminator="\n")


def read_csv(path: str | Path, columns: tuple[str, ...] = ()):
    """Read a CSV into a DataFrame; a missing file, a broken one or a missing column is an `InputError`."""
    import pandas as pd

    try:
        frame = pd.read_csv(path)
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file") from None
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError, IsADirectoryError) as error:
        raise InputError(path, None, None, f"not a readable CSV ({error})") from None
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
