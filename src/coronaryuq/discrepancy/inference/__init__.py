"""Fits: the problem, its noise, Gauss-Newton, cross-validation."""
