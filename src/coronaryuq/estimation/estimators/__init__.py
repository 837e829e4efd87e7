"""Estimators of a mean and its interval."""
