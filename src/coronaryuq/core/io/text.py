"""Text files as people's programs write them, and JSON in which no key may appear twice: one reader for every door."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from coronaryuq.core.errors import InputError


def read_text(path: str | Path) -> str:
    """Read UTF-8, with or without a byte-order mark; Snakemake reads no other encoding.

    Raises
    ------
    InputError
        If the file is missing, unreadable, or in another encoding; names the line.
    """
    if Path(path).is_fifo() and not Path(path).is_relative_to("/dev") and not Path(path).is_relative_to("/proc"):
        raise InputError(path, None, None, "is a named pipe, from which a reader may wait for ever; name a file")
    try:
        content = Path(path).read_bytes()
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file") from None
    except IsADirectoryError:
        raise InputError(path, None, None, "is a folder; name a file") from None
    except OSError as error:
        raise InputError(path, None, None, f"cannot be read ({error.strerror})") from None
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(path, f"line {line}", None, "not UTF-8 text; save the file in the encoding UTF-8") from None
    if "\0" in text:
        raise InputError(path, None, None, "not UTF-8 text; save the file in the encoding UTF-8")
    return text


class TwiceError(ValueError):
    """A key that is given twice in one JSON object."""

    def __init__(self, key: str):
        self.key = key
        super().__init__(f"{key} is given twice")


def parse_json(text: str) -> Any:
    """Parse JSON; raise `TwiceError`, a ValueError, for a key that is given twice in one object."""
    return json.loads(text, object_pairs_hook=_once)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise TwiceError(key)
        found[key] = value
    return found


def visible(folder: str | Path, pattern: str = "*") -> Iterator[Path]:
    """Yield the files of a folder that match, in the order of their names, without hidden ones.

    macOS leaves `._NAME` beside NAME on foreign disks: metadata that match the pattern of NAME.
    """
    yield from (path for path in sorted(Path(folder).glob(pattern)) if not path.name.startswith(".") and path.is_file())
