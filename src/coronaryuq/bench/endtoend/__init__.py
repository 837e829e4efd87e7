"""Whole campaigns on synthetic patients whose true FFR is known."""
