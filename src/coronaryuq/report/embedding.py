"""Files embedded in the page, so that it is one file that needs no network."""

import base64
import re
from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path

from markupsafe import Markup, escape

from coronaryuq.report.captions import CAPTIONS, SECTIONS

FIRST = 2
"""Number of the first of these figures; the tree in 3D is Figure 1."""
RENDERED = ("pictures",)
"""Sections whose figures are renderings."""
KINDS = {".png": "image/png", ".svg": "image/svg+xml"}


def data_url(path: str | Path, kind: str | None = None) -> str:
    """Return a file as a data URL; its kind follows from the suffix of a picture."""
    content = base64.b64encode(Path(path).read_bytes()).decode()
    return f"data:{kind or KINDS[Path(path).suffix]};base64,{content}"


def figures_of_sections(
    paths: Sequence[str], alternatives: Mapping[str, str], others: Mapping[str, int]
) -> dict[str, list[dict]]:
    """Return the figures of each section of the page: `name`, `number`, `caption`, `alt`, `data`, `file`.

    Numbers run through the page from 2, because the tree in 3D is the first.

    Parameters
    ----------
    paths
        PNG and SVG files. Of a figure in both formats the page has the drawing, SVG; of a rendering the image.
    alternatives
        What the data of a figure say, by its name; a figure without such a text has its caption.
    others
        Number of other figures that follow those of a section, by its name.
    """
    numbers, sections = count(FIRST), {}
    for section, names in SECTIONS.items():
        kinds = sorted(KINDS, reverse=section in RENDERED)
        by_name = {Path(path).stem: path for kind in kinds for path in paths if Path(path).suffix == kind}
        sections[section] = [
            {
                "name": name, "number": next(numbers), "caption": CAPTIONS[name], "data": data_url(by_name[name]),
                "file": Path(by_name[name]).name,
                "alt": alternatives.get(name, f"{CAPTIONS[name].title}. {CAPTIONS[name].see}"),
            }
            for name in names if name in by_name
        ]  # fmt: skip
        for _ in range(others.get(section, 0)):
            next(numbers)
    return sections


def in_code(text: str) -> Markup:
    """Return a text with the parts between backticks as code."""
    return Markup(re.sub(r"`([^`]*)`", r"<code>\1</code>", str(escape(text))))


def in_script(json_text: str) -> Markup:
    """Return JSON as the content of a script element, which no value can end."""
    return Markup(json_text.replace("<", "\\u003c"))


def unbroken(page: str) -> str:
    """Return a page in which no line break separates a number from its per cent sign or from its ±."""
    return re.sub(r"(?<=±) (?=\d)|(?<=\d) (?=%)", "\u00a0", page)
