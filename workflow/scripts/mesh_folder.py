"""Unpack the mesh into the folder that the flow solvers read."""

from pathlib import Path

from coronaryuq.flow3d.mesh.generation.folder import unpack
from job import job

with job(globals()) as this:
    unpack(this.input["archive"], Path(this.output["folder"]).parent)
