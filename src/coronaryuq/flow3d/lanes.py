"""How many samples advance side by side: the innermost, vectorised index of every array."""

LANES = 8
"""Samples per lane block; a block with fewer samples is filled up with copies of its first."""
