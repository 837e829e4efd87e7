"""Adapters for svSolver and svMultiPhysics."""
