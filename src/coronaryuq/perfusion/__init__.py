"""Perfusion territories and their flows under noise."""
