"""Names of a 0D network's parts as a reader knows them: `branch2_seg1` is part 2 of the LAD."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from coronaryuq.case.anatomy.tree import Tree, placed_stenoses
from coronaryuq.case.anatomy.vessel_names import readable_names
from coronaryuq.case.case_json import CaseOutlet, CaseStenosis
from coronaryuq.case.network.build import segments
from coronaryuq.case.network.network import AFTER_HEART

_PART = re.compile(r"(\w+)_seg(\d+)")


class InWords:
    """Replaces names of vessels, beds and places of a 0D network in the texts of a result.

    Parameters
    ----------
    vessels
        Readable name of each vessel of the tree.
    beds
        Readable name of each outlet, by the name of its bed.
    parts
        0D vessel → readable name and the number along it, from its start; 0 for a vessel that is one part.
    """

    def __init__(
        self,
        vessels: Mapping[str, str],
        beds: Mapping[str, str],
        parts: Mapping[str, tuple[str, int]] | None = None,
    ):
        self._vessels, self._beds, self._parts = vessels, beds, parts or {}

    @classmethod
    def of(
        cls, tree: Tree, outlets: Iterable[CaseOutlet], stenoses: Iterable[CaseStenosis], systemic: Iterable[str] = ()
    ) -> "InWords":
        """Return the words for the network of a case.

        An artery is several vessels of the tree, one from each bifurcation to the next; its parts are numbered through.
        """
        outlets, stenoses = list(outlets), list(stenoses)
        vessels = readable_names(tree, outlets)
        built = segments(tree, placed_stenoses(stenoses), [*(outlet.bc for outlet in outlets), *systemic])
        parts: dict[str, tuple[str, int]] = {}
        if {one.segment for one in stenoses} <= {one.name for one in built}:  # a given network has parts of its own
            whole, so_far = Counter(vessels[one.vessel] for one in built), Counter[str]()
            for one in built:
                name = vessels[one.vessel]
                so_far[name] += 1
                parts[one.name] = (name, so_far[name] if whole[name] > 1 else 0)
        return cls(vessels, {outlet.bc: outlet.label for outlet in outlets}, parts)

    def part_of(self, name: str) -> tuple[str, int] | None:
        """Return the artery of which a 0D vessel is a part, by its readable name, and the part's number."""
        if name in self._parts:
            return self._parts[name]
        found = _PART.fullmatch(name)
        if not found or found[1] not in self._vessels:
            return None
        return self._vessels[found[1]], int(found[2]) + 1

    def __call__(self, value: Any) -> Any:
        """Return a text, or a structure of lists and dictionaries, with readable names; pictures stay as they are."""
        if isinstance(value, dict):
            return {key: text if key in ("data", "file", "anchor") else self(text) for key, text in value.items()}
        if isinstance(value, list):
            return [self(item) for item in value]
        return self._text(value) if isinstance(value, str) else value

    def _text(self, text: str) -> str:
        # A place is between two parts of the network: FROM:TO.
        text = re.sub(rf"\b{AFTER_HEART}:\w+", "the start of the aorta", text)
        text = re.sub(r"\b\w+:(\w+)", lambda found: self._end(found) or found[0], text)
        text = re.sub(r"\b(\w+_seg\d+):\w+", lambda found: self._part(found[1]) or found[0], text)
        return re.sub(r"\b\w+\b", lambda found: self._bed(found[0]) or self._part(found[0]) or found[0], text)

    def _end(self, found: re.Match) -> str | None:
        return f"the end of {self._beds[found[1]]}" if found[1] in self._beds else self._part(found[1])

    def _bed(self, name: str) -> str | None:
        return f"the {self._beds[name]} bed" if name in self._beds else None

    def _part(self, name: str) -> str | None:
        # A vessel that has the name of a plain word would be found in any sentence.
        if name.isalpha():
            return None
        if found := self.part_of(name):
            return f"{found[0]} (part {found[1]})" if found[1] else found[0]
        return self._vessels.get(name)
