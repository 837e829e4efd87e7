"""Meshes: from centrelines, surfaces or a folder to `mesh-complete/` and `mesh.json` (docs/reference/formats.md)."""
