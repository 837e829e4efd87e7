"""Coronary haemodynamics of one patient, with calibrated error bars.

For notebooks and scripts (docs/how-to/notebook.md):

    open(folder)      results of a campaign as tables
    estimate(...)     mean of an expensive model's output from arrays of runs
    estimate_models(...), allocate(...)  the same with any number of models, and how many runs of each
    discover(...)     search for an effect that a model lacks
    zerod.solve(...)  one 0D network marched in time
    InputError        what they raise for wrong input: a ValueError of one line

Everything else may change.
"""

import importlib
import os

__version__ = "0.2.0"

# numba stops at its own import where this is no positive number.
if not os.environ.get("NUMBA_NUM_THREADS", "1").strip().lstrip("0").isdigit():
    del os.environ["NUMBA_NUM_THREADS"]

PUBLIC = {
    "open": ("coronaryuq.notebook.opened", "Opened"),
    "estimate": ("coronaryuq.estimation.arrays", "estimate"),
    "estimate_models": ("coronaryuq.estimation.models", "estimate_models"),
    "allocate": ("coronaryuq.estimation.models", "allocate"),
    "discover": ("coronaryuq.notebook.discover", "discover"),
    "zerod": ("coronaryuq.zerod", None),
    "InputError": ("coronaryuq.core.errors", "InputError"),
}
"""Name → module and attribute. They are imported when asked for: `import coronaryuq` stays fast."""


def __getattr__(name: str):
    if name not in PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = PUBLIC[name]
    found = importlib.import_module(module)
    return found if attribute is None else getattr(found, attribute)


def __dir__() -> list[str]:
    return ["__version__", *PUBLIC]
