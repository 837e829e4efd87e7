"""Draw one figure from result files."""

from coronaryuq.figures.draw import draw
from job import job

with job(globals()) as this:
    inputs = {name: path for name, path in this.input.items() if name != "code"}
    draw(this.params["name"], inputs, this.output["figure"])
