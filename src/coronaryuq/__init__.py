"""Coronary haemodynamics of one patient, with error bars that hold."""

from pathlib import Path

from coronaryuq.core.numba_cache import keep_apart

__version__ = "0.1.0"

keep_apart(Path(__file__).parent)
