"""Benchmarks: one module each, one JSON object each."""
