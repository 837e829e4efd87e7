"""Coronary haemodynamics of one patient, with error bars that hold."""

__version__ = "0.1.0"
