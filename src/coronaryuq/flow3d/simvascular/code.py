"""The SimVascular codes behind the interface of the 3D codes: one run directory and one MPI job per sample."""

import os
import shutil
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path

from coronaryuq.core import provenance, records
from coronaryuq.core.records import Record
from coronaryuq.flow3d.adapter import Outputs, Sample
from coronaryuq.flow3d.simvascular.coupled_case import CoupledCase
from coronaryuq.flow3d.simvascular.program import RunFailed, execute


class SimVascularCode(ABC):
    """A code that is prepared, run and read sample by sample.

    Parameters
    ----------
    case
        What all samples share.
    tasks
        MPI processes per sample.
    """

    name: str
    coupling: str

    def __init__(self, case: CoupledCase, tasks: int = 1):
        self.case, self.tasks = case, tasks

    @abstractmethod
    def prepare(self, sample: Sample, run: Path) -> None:
        """Write a complete run directory for one sample."""

    @abstractmethod
    def commands(self) -> list[list[str]]:
        """Return the programs with their arguments, to be run in the run directory one after the other."""

    @abstractmethod
    def collect(self, run: Path, sample: Sample) -> Record:
        """Read what the code wrote; raise `RunFailed` if it is missing, truncated or not finite."""

    @property
    def solver(self) -> dict[str, str]:
        """Name and coupling, for the record."""
        return {"name": self.name, "coupling": self.coupling}

    def run(self, samples: Sequence[Sample], outputs: Outputs) -> None:
        """Run samples one after the other; run directories of failed ones are kept beside the checkpoints.

        Records are kept after every sample, so that a stopped batch resumes: samples that ended well with the same
        inputs are not run again.
        """
        work = outputs.checkpoints / self._key()
        kept = work / f"batch_{samples[0].row}.jsonl"
        done = {record.sample: record for record in records.read(kept)} if kept.is_file() else {}
        rows = []
        for sample in samples:
            record = done.get(sample.name)
            if record is None or not record.ok or record.inputs != dict(sample.theta):
                record = self.run_sample(sample, work / sample.name)
            rows.append(record)
            records.write(kept, rows)
            if record.ok and not self.case.settings.keep:
                shutil.rmtree(work / sample.name, ignore_errors=True)
                shutil.rmtree(work / f"{sample.name}-mesh", ignore_errors=True)
        records.write(outputs.records, rows)
        kept.unlink()

    def run_sample(self, sample: Sample, folder: Path) -> Record:
        """Prepare, run and collect one sample; a run that fails ends as a record with the reason on one line."""
        begun, before = time.perf_counter(), os.times()
        run = folder.resolve()
        try:
            code = type(self)(self.case.drawn(sample, run.with_name(f"{run.name}-mesh")), self.tasks)
            code.prepare(sample, run)
            for line in code.commands():
                execute(line, run, self.case.settings.time_limit - (time.perf_counter() - begun))
            record = code.collect(run, sample)
        except RunFailed as error:
            record = Record.failed(sample.name, dict(sample.theta), str(error), solver=self.solver)
        after = os.times()
        record.cost |= {
            "cpu_s": (after.children_user - before.children_user) + (after.children_system - before.children_system),
            "wall_s": time.perf_counter() - begun,
        }
        return record

    def _key(self) -> str:
        """Return what a kept record must agree with besides θ."""
        case = self.case
        described = {
            "network": case.network,
            "mesh": case.domain.description.content(),
            "fluid": [case.density, case.viscosity],
            "settings": case.settings.model_dump(exclude={"mpi", "time_limit", "keep"}),
        }
        return f"{self.name}-{provenance.digest(described)}"
