"""Compare the campaign's mesh with a coarser and a finer one."""

from coronaryuq.flow3d.mesh_study import mesh_study
from job import job

with job(globals()) as this:
    names = ("coarse", "campaign", "fine")
    mesh_study({name: tuple(this.input[name]) for name in names}, "campaign", this.output["study"])
