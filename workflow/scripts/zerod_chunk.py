"""Run one portion of an input set through the 0D model."""

import tempfile
from pathlib import Path

from coronaryuq.posterior.settings import Settings as PosteriorSettings
from coronaryuq.posterior.stage import draw_samples
from coronaryuq.zerod.settings import Settings
from coronaryuq.zerod.stage import run_chunk
from job import job

with job(globals()) as this, tempfile.TemporaryDirectory() as folder:
    first, count = this.params["portion"]
    samples = Path(folder, "samples.csv")
    posterior = PosteriorSettings(**this.params["posterior"])
    draw_samples(this.input["draws"], posterior, this.params["seed"], this.params["set"], first + count, samples)
    settings = Settings(**this.params["settings"])
    run_chunk(this.input["network"], this.input["case"], samples, first, count, settings, this.output["runs"])
