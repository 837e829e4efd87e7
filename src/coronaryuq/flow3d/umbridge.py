"""A 3D model on an UM-Bridge server behind the interface of the 3D codes."""

import time
from collections.abc import Sequence

import numpy as np

from coronaryuq.core import records
from coronaryuq.core.records import Record
from coronaryuq.core.remote_model import RemoteModel, RemoteSettings
from coronaryuq.flow3d.adapter import Outputs, Sample


class UmbridgeAdapter:
    """Samples are sent to the server together, as many at a time as `parallel` says, and kept as they come back."""

    def __init__(self, settings: RemoteSettings):
        self.settings = settings
        self.model = RemoteModel(settings, settings.model or "flow3d", "flow3d.umbridge")

    def run(self, samples: Sequence[Sample], outputs: Outputs) -> None:
        kept = outputs.checkpoints / f"umbridge_{samples[0].row}.jsonl"
        done = {record.sample: record for record in records.read(kept)} if kept.is_file() else {}
        rows = {s.name: done[s.name] for s in samples if s.name in done and done[s.name].inputs == dict(s.theta)}
        waiting = [sample for sample in samples if sample.name not in rows or not rows[sample.name].ok]
        for first in range(0, len(waiting), self.settings.parallel):
            part = waiting[first : first + self.settings.parallel]
            rows |= {record.sample: record for record in self._ask(part)}
            records.write(kept, rows.values())
        records.write(outputs.records, [rows[sample.name] for sample in samples])
        kept.unlink(missing_ok=True)

    def _ask(self, samples: Sequence[Sample]) -> list[Record]:
        names = list(samples[0].theta)
        begun = time.perf_counter()
        answers = self.model.evaluate(np.array([[sample.theta[name] for name in names] for sample in samples]), names)
        # The server does not tell what a run has cost; the waiting time stands in for it.
        spent = (time.perf_counter() - begun) / len(samples)
        solver = {"name": "umbridge", "version": f"{self.model.name} at {self.settings.url}"}
        cost = {"cpu_s": spent, "wall_s": spent}
        found = []
        for sample, answer in zip(samples, answers, strict=True):
            inputs = dict(sample.theta)
            if isinstance(answer, str):
                found.append(Record.failed(sample.name, inputs, answer, solver=solver, cost=cost))
            else:
                outputs = dict(zip(self.model.outputs, answer, strict=True))
                found.append(Record(sample.name, inputs, outputs, solver=solver, cost=cost))
        return found
