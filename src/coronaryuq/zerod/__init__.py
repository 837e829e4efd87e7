"""The 0D model: engine, networks, effects, and `solve`."""

import importlib


def __getattr__(name: str):
    if name == "solve":
        # By name, so that importing the package imports nothing else, and its code digest covers nothing else.
        return importlib.import_module("coronaryuq.zerod.solve_network").solve
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
