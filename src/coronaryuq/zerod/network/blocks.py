"""Checks of any block of a network file: known keys, values of the right type, a unique name."""

import math
from collections.abc import Callable, Iterable
from numbers import Real
from typing import Any

from coronaryuq.case.network.network import UNCERTAIN
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.parameters import Parameters


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_object(value: Any) -> bool:
    return isinstance(value, dict)


def _is_list_of(kind: type) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, list) and all(type(entry) is kind for entry in value)


_SHAPES: dict[str, dict[str, tuple[Callable[[Any], bool], str]]] = {
    "vessels": {
        "zero_d_element_type": (_is_text, "text"),
        "boundary_conditions": (lambda v: _is_object(v) and all(map(_is_text, v.values())), "an object of names"),
    },
    "boundary_conditions": {"bc_type": (_is_text, "text")},
    "external_solver_coupling_blocks": {"type": (_is_text, "text"), "location": (_is_text, "text")},
    "closed_loop_blocks": {
        "closed_loop_type": (_is_text, "text"),
        "outlet_blocks": (_is_list_of(str), "a list of block names"),
    },
    "valves": {"type": (_is_text, "text")},
    "chambers": {"type": (_is_text, "text"), "activation_function": (_is_object, "an object")},
    UNCERTAIN: {},
    "junctions": {
        "junction_type": (_is_text, "text"),
        "junction_values": (_is_object, "an object"),
        **{f"{side}_vessels": (_is_list_of(int), "a list of vessel_id") for side in ("inlet", "outlet")},
        **{f"{side}_blocks": (_is_list_of(str), "a list of block names") for side in ("inlet", "outlet")},
    },
}
"""Type of a key's value, where other checks rely on it."""


def check_shapes(network: dict[str, Any], file) -> None:
    """Raise `InputError` unless every part is a list of objects whose values have the right type."""
    for part, keys in _SHAPES.items():
        entries = network.get(part, [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise InputError(file, part, None, "expected a list of objects")
        for number, entry in enumerate(entries):
            for key, (fits, wanted) in keys.items():
                if key in entry and not fits(entry[key]):
                    raise InputError(file, f"{part}[{number}].{key}", entry[key], f"expected {wanted}")
    for part in ("initial_condition", "initial_condition_d"):
        if not isinstance(network.get(part, {}), dict):
            raise InputError(file, part, network[part], "expected an object")


def named(network: dict[str, Any], part: str, key: str, file) -> Iterable[dict]:
    """Return the blocks of one part of a network; raise `InputError` for one without a name under `key`."""
    blocks = network.get(part, [])
    for number, block in enumerate(blocks):
        if not isinstance(block.get(key), str) or not block[key]:
            raise InputError(file, f"{part}[{number}].{key}", block.get(key), "expected a name")
    return blocks


def register(block: dict, name_key: str, type_key: str, known: dict, names: dict[str, str], file, part: str) -> str:
    """Check a block's element against `known`, add its name to `names` (name → place in file), and return it."""
    name, kind = block[name_key], block.get(type_key)
    if kind not in known:
        raise InputError(file, f"{part}.{name}.{type_key}", kind, f"unknown element; known: {', '.join(known)}")
    if name in names:
        raise InputError(file, f"{part}.{name}", None, f"name already taken by {names[name]}; rename one")
    names[name] = f"{part}.{name}"
    return name


def check_keys(block: dict, known: set[str], file, where: str) -> None:
    """Raise `InputError` for an unknown key; keys that begin with _ are comments."""
    for key in block:
        if key not in known and not key.startswith("_"):
            field = f"{where}.{key}" if where else key
            raise InputError(file, field, None, f"unknown key; known: {', '.join(sorted(known))}")


def check_values(block: dict, key: str, parameters: Parameters, file, where: str) -> None:
    """Raise `InputError` unless `block[key]` has all required parameters of an element, each of the right type."""
    values = block.get(key)
    if not isinstance(values, dict):
        raise InputError(file, f"{where}.{key}", values, "expected an object")
    check_keys(values, set(parameters), file, f"{where}.{key}")
    series = [name for name, spec in parameters.items() if spec.series]
    for name, spec in parameters.items():
        field = f"{where}.{key}.{name}"
        if name not in values:
            if spec.required:
                raise InputError(file, field, None, "missing")
            continue
        value = values[name]
        if spec.flag:
            if not isinstance(value, bool):
                raise InputError(file, field, value, "expected true or false")
        elif spec.name:
            if not _is_text(value):
                raise InputError(file, field, value, "expected a block's name")
        elif spec.series:
            if not isinstance(value, list) or not value or not all(map(finite, value)):
                raise InputError(file, field, value, "expected a list of numbers")
            if len(value) > 1 and len(value) != len(values.get("t", [])):
                raise InputError(
                    file, field, len(value), f"must have as many entries as t ({len(values.get('t', []))})"
                )
        elif not finite(value):
            raise InputError(file, field, value, "expected a number")
        elif spec.positive and not value > 0:
            raise InputError(file, field, value, "expected a positive number")
    times = values.get("t", [])
    if series and any(later <= earlier for earlier, later in zip(times, times[1:], strict=False)):
        raise InputError(file, f"{where}.{key}.t", None, "times must increase")


def finite(value: Any) -> bool:
    """Return whether a value is a finite number (and neither true nor false)."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond the range of floats
        return False
