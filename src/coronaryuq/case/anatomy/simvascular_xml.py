"""XML as SimVascular writes it: two roots in one file, text in any code page."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.text import read_text

LARGEST = 200_000_000
"""Maximum size of one file, bytes."""


def read_xml(path: Path) -> ElementTree.Element:
    """Return the content of a file; raise InputError if it is empty, too large or no XML."""
    if path.stat().st_size > LARGEST:
        raise InputError(path, None, f"{path.stat().st_size} bytes", f"more than {LARGEST} bytes")
    try:
        text = read_text(path)
    except InputError:  # names in an old code page; coordinates are ASCII
        text = path.read_text(encoding="latin-1")
    if not text.strip():
        raise InputError(path, None, None, "is empty; save it again in SimVascular, or delete it")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(path, None, None, "contains a document type definition, which SimVascular never writes")
    # SimVascular writes a `format` element before the root: two roots, which XML does not allow.
    body = text[text.index("?>") + 2 :] if text.lstrip().startswith("<?xml") and "?>" in text else text
    try:
        return ElementTree.fromstring(f"<file>{body}</file>")
    except ElementTree.ParseError as error:
        raise InputError(path, None, None, f"not valid XML ({error})") from None


def read_points(path: Path, element: ElementTree.Element, where: str) -> np.ndarray:
    """Return the coordinates (n, 3) of the points at an XPath of an element."""
    try:
        points = np.array([[float(p.attrib[k]) for k in "xyz"] for p in element.findall(where)], dtype=float)
    except (KeyError, ValueError) as error:
        raise InputError(path, where, None, f"a point lacks x, y or z ({error})") from None
    if not np.isfinite(points).all():
        raise InputError(path, where, None, "a point is not finite")
    return points.reshape(-1, 3)
