"""STL files as scanners, segmentation programs and converters write them, binary or ASCII."""

import codecs
import re
from pathlib import Path

import numpy as np

from coronaryuq.core.errors import InputError

HEADER, RECORD = 84, 50
"""Bytes before the triangles of a binary file, and of each triangle."""
VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
EXPORT = "export the surface again"


def read_stl(path: Path) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the corners (n, 3, 3) of the triangles, in the file's unit, and notes.

    A file is binary if its length says so, or if it does not begin with `solid`; bytes behind the triangles are left
    alone, with a note. Keywords of ASCII files may be in capitals.

    Raises
    ------
    InputError
        If the file is truncated, holds no triangle, or a coordinate is no finite number.
    """
    content = path.read_bytes().removeprefix(codecs.BOM_UTF8)
    number = int.from_bytes(content[80:84], "little") if len(content) >= HEADER else 0
    end = HEADER + RECORD * number
    text = content[:512].lstrip().lower().startswith(b"solid") and VERTEX.search(content) is not None
    notes: tuple[str, ...] = ()
    if text and len(content) != end:
        corners = _ascii(path, content)
    elif len(content) < HEADER or number == 0:
        raise InputError(path, "triangles", 0, f"not an STL file, or an empty one; {EXPORT}")
    elif len(content) < end:
        held = (len(content) - HEADER) // RECORD
        raise InputError(path, "triangles", held, f"truncated: the header announces {number}; {EXPORT}")
    else:
        records = np.frombuffer(content, np.uint8, RECORD * number, HEADER).reshape(number, RECORD)
        corners = records[:, 12:48].copy().view("<f4").reshape(number, 3, 3).astype(float)
        if len(content) > end:
            notes = (f"surface: {path.name} has {len(content) - end} bytes behind its triangles, which were left out",)
    if not np.isfinite(corners).all():
        raise InputError(path, "vertex", None, f"a coordinate is not a finite number; {EXPORT}")
    return corners, notes


def _ascii(path: Path, content: bytes) -> np.ndarray:
    try:
        values = np.array([[float(x) for x in vertex] for vertex in VERTEX.findall(content)])
    except ValueError as error:
        raise InputError(path, "vertex", None, f"expected numbers with a decimal point ({error}); {EXPORT}") from None
    if len(values) % 3:
        raise InputError(path, "vertex", len(values), f"truncated: not three per triangle; {EXPORT}")
    return values.reshape(-1, 3, 3)
