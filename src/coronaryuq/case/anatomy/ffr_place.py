"""The place beyond a stenosis at which its FFR is read."""

from collections.abc import Sequence
from dataclasses import replace

from coronaryuq.case.anatomy.tree import Stenosis, Tree
from coronaryuq.case.case_json import FfrPlace, Stop

STOPS: dict[Stop, str] = {
    "end": "the last place before its vessel ends",
    "branch": "the last place before its vessel branches",
    "stenosis": "the last place before the next stenosis",
}
"""Why FFR is read nearer than asked for, in words."""
SAME = 0.05
"""cm: distances that are no different to a reader of whole millimetres."""


def with_ffr_places(tree: Tree, stenoses: Sequence[Stenosis], beyond: float) -> list[Stenosis]:
    """Return the stenoses, each with the place at which its FFR is read.

    The place lies `beyond` the end of the stenosis in the same vessel or, if that is farther than the vessel goes
    before its end or branching (less one radius, so that a cross-section fits) or before the next stenosis, at the
    last point before.

    Parameters
    ----------
    tree
        The centreline tree.
    stenoses
        All stenoses of the tree.
    beyond
        Distance asked for, cm.
    """
    return [replace(stenosis, read=_place(tree, stenosis, stenoses, beyond)) for stenosis in stenoses]


def ffr_notes(stenoses: Sequence[Stenosis]) -> tuple[str, ...]:
    """Return a note for each stenosis whose FFR is read nearer than asked, by more than half a millimetre."""
    return tuple(
        f"stenosis {s.name}: FFR is read {10 * (s.read.arc - s.end):.0f} mm beyond it, {STOPS[s.read.stop]}; "
        f"{10 * s.read.asked:g} mm were asked for (ffr_beyond_mm)"
        for s in stenoses
        if s.read is not None and s.read.stop is not None and s.end + s.read.asked - s.read.arc > SAME
    )


def _place(tree: Tree, stenosis: Stenosis, stenoses: Sequence[Stenosis], beyond: float) -> FfrPlace:
    vessel = tree[stenosis.vessel]
    last = vessel.length - float(vessel.radii[-1])
    stop: Stop = "branch" if len(tree.children(vessel.name)) > 1 else "end"
    starts = [other.start for other in stenoses if other.vessel == vessel.name and other.start > stenosis.start]
    if starts and min(starts) <= last:
        last, stop = min(starts), "stenosis"
    last = max(last, stenosis.end)
    wanted = stenosis.end + beyond
    return FfrPlace(arc=min(wanted, last), asked=beyond, stop=stop if wanted > last else None)
