"""States carried over from a network to the same one with added elements."""

import numpy as np


def carry_over(names: list[str], state: np.ndarray, wanted: list[str], renamed: dict[str, str]) -> np.ndarray:
    """Transfer a state to the same network with added elements.

    names, state: unknowns of the network without the elements. wanted: unknowns of the network with them. renamed: old
    → new locations. An added vessel starts without flow, at the pressure of the vessel or bed to which it is attached;
    a vessel whose end was moved keeps its flow.
    """
    known = dict(zip(names, state, strict=True))
    before = {new: old for old, new in renamed.items()}
    moved: dict[str, str] = {}
    stubs: dict[str, str] = {}
    for old, new in renamed.items():
        (feeder, fed), (stub, ahead) = old.split(":"), new.split(":")
        # A vessel added distally takes over the end of the old one, a vessel added upstream its start.
        first, second = (feeder, stub) if fed == ahead else (ahead, fed)
        moved[first] = stubs[second] = old
    found: dict[str, float] = {}
    for name in wanted:
        kind, _, location = name.partition(":")
        first, _, second = location.partition(":")
        origin = before.get(location) or moved.get(first) or stubs.get(second)
        for candidate in (name, f"{kind}:{origin}"):
            if candidate in known and name not in found:
                found[name] = known[candidate]
    for kind in ("pressure", "d_pressure"):
        _fill_from_neighbours(found, [name for name in wanted if name.startswith(f"{kind}:")])
    return np.array([found.get(name, 0.0) for name in wanted])


def _fill_from_neighbours(found: dict[str, float], locations: list[str]) -> None:
    """Give missing locations, KIND:BLOCK:BLOCK, the value of the first known one that shares a block, repeatedly."""
    wanted = set(locations)
    known = [name for name in found if name in wanted]
    first: dict[str, int] = {}
    for turn, name in enumerate(known):
        for block in name.split(":")[1:]:
            first.setdefault(block, turn)
    waiting, left = [name for name in locations if name not in found], -1
    while len(waiting) != left:
        left = len(waiting)
        for name in waiting:
            blocks = name.split(":")[1:]
            near = [first[block] for block in blocks if block in first]
            if near:
                found[name] = found[known[min(near)]]
                for block in blocks:
                    first.setdefault(block, len(known))
                known.append(name)
        waiting = [name for name in waiting if name not in found]
