"""Coronary haemodynamics of one patient, with calibrated error bars."""

__version__ = "0.1.0"
