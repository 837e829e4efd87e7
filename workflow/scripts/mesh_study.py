"""Compare the campaign's mesh with a coarser and a finer one, and its time step with half of it."""

from coronaryuq.flow3d.mesh_study import mesh_study
from job import job

with job(globals()) as this:
    names = ("coarse", "campaign", "fine")
    meshes = {name: tuple(this.input[name]) for name in names}
    mesh_study(meshes, "campaign", this.input["halved_step"], this.output["study"])
