"""Tetrahedra: surfaces filled piece by piece, in processes of their own; the mesh folder."""
