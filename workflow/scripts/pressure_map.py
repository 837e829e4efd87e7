"""Mean pressure along the tree at the posterior mean."""

from coronaryuq.zerod.pressure_map import write_map
from job import job

with job(globals()) as this:
    names = ("network", "case", "tree", "draws")
    write_map(*(this.input[name] for name in names), this.output["pressures"])
