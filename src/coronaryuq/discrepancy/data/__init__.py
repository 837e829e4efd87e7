"""Measurements, conditions, recorded animals."""
