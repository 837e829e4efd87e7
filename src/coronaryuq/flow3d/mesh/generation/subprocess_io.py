"""Objects passed between processes through a file: arrays in an `.npz`, the rest as JSON in it; no pickle.

A file can be altered by whoever may write to it, and unpickling executes what it holds. Here a file only fills objects
of this package's own classes, and cannot name a function.
"""

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np

PACKAGE = __name__.partition(".")[0]


def write(path: str | Path, value: Any) -> None:
    """Write numbers, text, lists, mappings, arrays and objects of this package made of those; else raise TypeError."""
    arrays: list[np.ndarray] = []
    text = json.dumps(_packed(value, arrays))
    np.savez(path, allow_pickle=False, parcel=np.array(text), **{f"a{k}": array for k, array in enumerate(arrays)})


def read(path: str | Path) -> Any:
    """Read what `write` wrote; tuples come back as tuples, arrays with their bits."""
    with np.load(path, allow_pickle=False) as held:
        return _unpacked(json.loads(str(held["parcel"])), held)


def _packed(value: Any, arrays: list[np.ndarray]) -> Any:
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        if value.dtype == object:
            value = value.astype(str)
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if isinstance(value, list | tuple):
        return {type(value).__name__: [_packed(item, arrays) for item in value]}
    if isinstance(value, dict):
        return {"dict": [[_packed(key, arrays), _packed(item, arrays)] for key, item in value.items()]}
    kind = type(value)
    if kind.__module__.partition(".")[0] != PACKAGE or not hasattr(value, "__dict__"):
        raise TypeError(f"{kind.__name__} cannot be written without pickle")
    return {"object": [kind.__module__, kind.__qualname__], "state": _packed(vars(value), arrays)}


def _unpacked(value: Any, held) -> Any:
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return held[f"a{value['array']}"]
    if "list" in value:
        return [_unpacked(item, held) for item in value["list"]]
    if "tuple" in value:
        return tuple(_unpacked(item, held) for item in value["tuple"])
    if "dict" in value:
        return {_unpacked(key, held): _unpacked(item, held) for key, item in value["dict"]}
    module, name = value["object"]
    if module.partition(".")[0] != PACKAGE:
        raise ValueError(f"{module}.{name} is no class of {PACKAGE}")
    kind = getattr(importlib.import_module(module), name)
    if not isinstance(kind, type) or kind.__module__ != module:
        raise ValueError(f"{module}.{name} is no class of {PACKAGE}")
    made: Any = object.__new__(kind)
    for field, item in _unpacked(value["state"], held).items():
        object.__setattr__(made, field, item)
    return made
