"""Pressure losses that the 0D vessels lack, learnt from a few 3D runs."""
