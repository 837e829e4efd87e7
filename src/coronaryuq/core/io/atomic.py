"""Files that are either complete or absent: written next to their destination, then renamed. Text and JSON."""

import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from coronaryuq.core.errors import REMEDIES, InputError
from coronaryuq.core.io.text import TwiceError, parse_json, read_text


@contextmanager
def replacing(path: str | Path, room: int = 0) -> Iterator[Path]:
    """Yield a temporary path that replaces `path` on success and is deleted on any error.

    Parameters
    ----------
    path
        Destination. The temporary file lies in the same folder and has the same suffix, because many writers choose
        their format by it.
    room
        Bytes to reserve first, for writers that crash on a full disk.

    Raises
    ------
    OSError
        If the file cannot be written; names `path`.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            if room and hasattr(os, "posix_fallocate"):  # not on macOS
                with open(temporary, "wb") as reserved:
                    os.posix_fallocate(reserved.fileno(), 0, room)
            yield temporary
            with open(temporary, "rb") as written:
                os.fsync(written.fileno())
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        if error.errno not in REMEDIES or error.filename not in (None, str(temporary)):
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error


def check_folder(path: str | Path) -> Path:
    """Return `path` if results can be written there; meant for use before long work, and creates nothing.

    Raises
    ------
    InputError
        If the name is empty, a file is in the way, or the file system rejects new files.
    """
    if not str(path):
        raise InputError("command line", "--out", "", "empty; name a folder")
    path = Path(path)
    existing = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
    if not existing.is_dir():
        raise InputError(path, None, None, f"expected a folder for results, but {existing} is a file")
    try:
        # Permissions are not sufficient: root may write anywhere, except on a read-only or virtual file system.
        tempfile.TemporaryFile(dir=existing).close()
    except OSError as error:
        remedy = f"cannot create files in {existing} ({error.strerror}); name another folder for results"
        raise InputError(path, None, None, remedy) from None
    return path


def check_file(path: str | Path) -> Path:
    """Return `path` if a file can be written there; see `check_folder`."""
    path = Path(path)
    if path.is_dir():
        raise InputError(path, None, None, "is a folder; name a file in it")
    check_folder(path.parent)
    return path


def write_text(path: str | Path, text: str) -> None:
    """Write UTF-8 text with unchanged newlines."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def write_json(path: str | Path, value: Any) -> None:
    """Write JSON with floats in their shortest exact form, so that reading returns the same bits."""
    write_text(path, json.dumps(value, indent=1, ensure_ascii=False, default=json_default) + "\n")


def read_json(path: str | Path, keys: tuple[str, ...] = ()) -> Any:
    """Read a JSON file.

    Parameters
    ----------
    path
        The file, in an encoding that `read_text` knows.
    keys
        Required keys; if any are given, the file must contain a JSON object.

    Raises
    ------
    InputError
        If the file is missing, unreadable or malformed, or a key is missing or given twice.
    """
    try:
        value = parse_json(read_text(path))
    except InputError:
        raise
    except TwiceError as error:
        raise InputError(path, error.key, None, "given twice in one object; keep one") from None
    except (ValueError, RecursionError) as error:
        raise InputError(path, None, None, f"not valid JSON ({error}); recreate it") from None
    if keys and not isinstance(value, dict):
        raise InputError(path, None, value, f"expected a JSON object with {', '.join(keys)}; recreate it")
    for key in keys:
        if key not in value:
            raise InputError(path, key, None, f"missing; the file has {', '.join(map(str, value))}; recreate it")
    return value


def json_default(value: Any) -> Any:
    """Return the JSON form of a numpy scalar, an array or a path; for `default` of `json.dumps`."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Path):
        return value.as_posix()
    raise TypeError(f"{type(value).__name__} has no JSON form")
