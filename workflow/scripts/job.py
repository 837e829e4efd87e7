"""What every script needs: its files and parameters from Snakemake or from the command line, a log, one-line errors.

    with job(globals()) as this:
        stage_function(this.input["case"], this.params["settings"], this.output["targets"])

Under Snakemake the rule gives them. By hand:

    python workflow/scripts/NAME.py --input case=PATH --output targets=PATH \
        --params '{"seed": 1}' [--threads N] [--log PATH]

A name that is given more than once is a list. Progress goes to the terminal and to the log alike.
"""

import argparse
import json
import os
import resource
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from coronaryuq.cli.explain import write_note
from coronaryuq.core.errors import InputError, os_error_line


@dataclass
class Job:
    """Inputs and outputs (name → path, or list of paths), parameters, threads, log; MPI launcher and tasks, if any."""

    input: dict[str, Any]
    output: dict[str, Any]
    params: dict[str, Any]
    threads: int
    log: str | None
    name: str = ""
    mpi: str = "mpiexec"
    tasks: int = 1


class Tee:
    """A text stream that writes to several."""

    def __init__(self, *streams):
        self.streams = streams

    def write(self, text: str) -> int:
        for stream in self.streams:
            with suppress(OSError):  # a log on a full disk keeps nothing from the terminal
                stream.write(text)
                stream.flush()
        return len(text)

    def flush(self) -> None:
        for stream in self.streams:
            with suppress(OSError):
                stream.flush()

    def isatty(self) -> bool:
        return False


@contextmanager
def job(script_globals: dict[str, Any]) -> Iterator[Job]:
    this = _from_snakemake(script_globals["snakemake"]) if "snakemake" in script_globals else _from_command_line()
    terminal = sys.stderr
    log = None
    if this.log:
        Path(this.log).parent.mkdir(parents=True, exist_ok=True)
        log = open(this.log, "w", encoding="utf-8")  # noqa: SIM115 (closed below, after the error has gone into it)
        sys.stderr = Tee(terminal, log)
    started = time.perf_counter()
    print(f"{this.name}: started", file=sys.stderr)
    try:
        with threadpool_limits(this.threads):  # linear algebra takes no more cores than the job was given
            yield this
        used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        cpu = sum(usage.ru_utime + usage.ru_stime for usage in used)
        peak = max(usage.ru_maxrss for usage in used) / 1024
        # The report adds these lines up.
        wall = time.perf_counter() - started
        spent = f"cost: wall {wall:.2f} s, cpu {cpu:.2f} s, memory {peak:.0f} MB"
        if _rank() == 0:
            leave_note(this, {"wall_s": round(wall, 2), "cpu_s": round(cpu, 2), "memory_mb": round(peak)})
        print(f"{this.name}: done; {spent}", file=sys.stderr)
    except InputError as error:
        print(f"{this.name}: error: {error}", file=sys.stderr)
        sys.exit(InputError.EXIT_CODE)
    except Exception as error:
        told = os_error_line(error) if isinstance(error, OSError) else None
        if told:
            print(f"{this.name}: error: {told}", file=sys.stderr)
        else:
            traceback.print_exc()
        sys.exit(1)
    finally:
        sys.stderr = terminal
        if log:
            with suppress(OSError):
                log.close()


def leave_note(this: Job, cost: dict[str, float]) -> None:
    """Write down what became of this job, for `coronaryuq explain`."""
    ranks = int(next((os.environ[name] for name in ("PMI_SIZE", "SLURM_STEP_NUM_TASKS") if name in os.environ), 1))
    resources = {"threads": this.threads, "mpi_ranks": ranks, **cost}
    write_note(this.name, this.input, this.output, this.params, resources, Path(__file__).resolve().parents[2])


def _rank() -> int:
    """This process's MPI rank, as mpiexec and srun tell it."""
    return int(next((os.environ[name] for name in ("PMI_RANK", "PMIX_RANK", "SLURM_PROCID") if name in os.environ), 0))


def _from_snakemake(snakemake) -> Job:
    return Job(
        input={name: _paths(value) for name, value in snakemake.input.items()},
        output={name: _paths(value) for name, value in snakemake.output.items()},
        params=dict(snakemake.params.items()),
        threads=snakemake.threads,
        log=snakemake.log[0] if len(snakemake.log) else None,
        name=" ".join([snakemake.rule, *map(str, snakemake.wildcards)]),
        mpi=snakemake.resources.get("mpi", "mpiexec"),
        tasks=snakemake.resources.get("tasks", 1),
    )


def _paths(value) -> Any:
    return str(value) if isinstance(value, str) else [str(path) for path in value]


def _from_command_line() -> Job:
    parser = argparse.ArgumentParser(formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--input", nargs="*", default=[], metavar="NAME=PATH")
    parser.add_argument("--code", nargs="*", default=[], metavar="PATH", help="source files behind the results")
    parser.add_argument("--output", nargs="*", default=[], metavar="NAME=PATH")
    parser.add_argument("--params", default="{}", help="JSON object")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--log")
    given = parser.parse_args()
    name = Path(sys.argv[0]).stem
    inputs = _pairs(given.input) | {"code": given.code}
    return Job(inputs, _pairs(given.output), json.loads(given.params), given.threads, given.log, name)


def _pairs(items: list[str]) -> dict[str, Any]:
    pairs: dict[str, Any] = {}
    for item in items:
        name, _, path = item.partition("=")
        if name in pairs:
            pairs[name] = [*(pairs[name] if isinstance(pairs[name], list) else [pairs[name]]), path]
        else:
            pairs[name] = path
    return pairs
