"""Meshes: from centrelines, surfaces or an existing folder to `mesh-complete/` and `mesh.json` (docs/formats.md)."""
