"""Flows with known solutions, for tests and benchmarks."""
