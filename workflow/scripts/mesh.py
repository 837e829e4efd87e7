"""Mesh the part of the anatomy that runs in 3D."""

from pathlib import Path

from coronaryuq.flow3d.mesh.settings import Settings
from coronaryuq.flow3d.mesh.stage import make_mesh
from job import job

with job(globals()) as this:
    make_mesh(
        Path(this.input["case"]),
        Path(this.input["tree"]),
        Path(this.input["network"]),
        Settings(**this.params["settings"]),
        Path(this.output["description"]).parent,
        Path(this.params["lumen"]) if this.params["lumen"] else None,
    )
