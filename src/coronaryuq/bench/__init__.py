"""Benchmarks: one module each, with a function `run` that returns one JSON object."""
