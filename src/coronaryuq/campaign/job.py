"""The frame of a job: its files and parameters from Snakemake or the command line, a log, a note, one-line errors.

    with job(globals()) as this:
        this.call()

Under Snakemake the rule provides them. By hand:

    python workflow/scripts/stage.py --input case_json=PATH --output targets_json=PATH \
        --params '{"function": "MODULE:FUNCTION", "seed": 1}' [--threads N] [--ranks N] [--log PATH]

A name that is given more than once is a list, one with an empty path is left out. Progress goes to the terminal and to
the log alike.

Keywords of the function are the names of the rule's inputs, outputs and parameters. Inputs and outputs that it does not
take are dependencies. It also receives, if it takes them and the rule does not name them: `threads`, `ranks`, `mpi` and
`tasks`; `out_dir`, the folder of the outputs; `NAME_folder`, the folder of the files that are the input NAME. Settings
are converted to the model of their annotation. An output `cost`, the cost of the job, is written here.
"""

import argparse
import importlib
import inspect
import json
import os
import resource
import sys
import time
import traceback
import typing
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from threadpoolctl import threadpool_limits

from coronaryuq.campaign.explain import write_note
from coronaryuq.core import shipped
from coronaryuq.core.errors import InputError, os_error_line
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.launcher import LOCAL_MPIEXEC
from coronaryuq.core.ranks import Ranks

RUNNER = ("function", "code")
"""Parameters of a rule that are not passed to the function."""


@dataclass
class Job:
    """Inputs and outputs (name → path, or list of paths), parameters, threads, log.

    mpi, tasks: launcher and number of ranks of a program that the job starts. size: ranks of the job itself.
    """

    input: dict[str, Any]
    output: dict[str, Any]
    params: dict[str, Any]
    threads: int
    log: str | None
    name: str = ""
    mpi: str = LOCAL_MPIEXEC
    tasks: int = 1
    size: int = 1

    @cached_property
    def ranks(self) -> Ranks:
        """Ranks of the job, this process among them."""
        return Ranks.started(self.size, self.threads)

    def function(self) -> Callable:
        """Return the function named in the parameters."""
        module, _, name = self.params["function"].partition(":")
        return getattr(importlib.import_module(module), name)

    def call(self) -> None:
        """Run that function; its output is treated as progress."""
        arguments = self.arguments(self.function())
        with redirect_stdout(sys.stderr):
            self.function()(**arguments)

    def arguments(self, function: Callable) -> dict[str, Any]:
        """Return the keywords of a call.

        Raises
        ------
        TypeError
            If the function requires a keyword that the rule does not have, or does not take one of the rule's
            parameters.
        """
        params = {name: value for name, value in self.params.items() if name not in RUNNER}
        files = self.input | self.output
        if twice := (self.input.keys() & self.output.keys()) | (params.keys() & files.keys()):
            raise TypeError(f"{self.name}: named twice in its rule: {', '.join(sorted(twice))}")
        signature = inspect.signature(function)
        takes = {parameter.name: parameter for parameter in signature.parameters.values()}
        rest = any(parameter.kind is parameter.VAR_KEYWORD for parameter in takes.values())
        offered = self._of_the_job(takes) | {
            name: path for name, path in files.items() if name in takes or (rest and name not in ("cost", "code"))
        }
        hints = typing.get_type_hints(function)
        arguments = {name: _as(hints.get(name), value) for name, value in (offered | params).items()}
        signature.bind(**arguments)
        return arguments

    def _of_the_job(self, takes: typing.Container[str]) -> dict[str, Any]:
        outputs = [path for name, path in self.output.items() if name != "cost" and isinstance(path, str)]
        values: dict[str, Any] = {"threads": self.threads, "mpi": self.mpi, "tasks": self.tasks}
        values |= {"ranks": self.ranks} if "ranks" in takes else {}
        values |= {"out_dir": Path(outputs[0]).parent} if outputs else {}
        values |= {f"{name}_folder": Path(files[0]).parent for name, files in self.input.items() if _several(files)}
        return {name: value for name, value in values.items() if name in takes}


def _several(files: Any) -> bool:
    return isinstance(files, list) and bool(files)


def _as(hint: Any, value: Any) -> Any:
    """Convert a value to the type of its annotation: a model of settings, a `Path`."""
    if isinstance(hint, type) and issubclass(hint, BaseModel) and isinstance(value, dict):
        return hint(**value)
    if isinstance(value, str) and str not in typing.get_args(hint) and (hint is Path or Path in typing.get_args(hint)):
        return Path(value)
    return value


class Tee:
    """A text stream that writes to several streams."""

    def __init__(self, *streams):
        self.streams = streams

    def write(self, text: str) -> int:
        for stream in self.streams:
            with suppress(OSError):  # a full disk for the log must not suppress output on the terminal
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
        this.function()  # loads its libraries, because the limit applies only to loaded ones
        with threadpool_limits(this.threads):  # linear algebra uses no more cores than the job has
            yield this
        used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        cpu = sum(usage.ru_utime + usage.ru_stime for usage in used)
        peak = max(usage.ru_maxrss for usage in used) / 1024
        cost = {"wall_s": round(time.perf_counter() - started, 2), "cpu_s": round(cpu, 2), "memory_mb": round(peak)}
        if this.ranks.rank == 0:
            if "cost" in this.output:
                write_json(this.output["cost"], {"job": this.name, **cost})
            leave_note(this, cost)
        spent = "wall {wall_s} s, cpu {cpu_s} s, memory {memory_mb} MB".format(**cost)
        print(f"{this.name}: done; cost: {spent}", file=sys.stderr)
    except KeyboardInterrupt:
        print(f"{this.name}: interrupted", file=sys.stderr)
        sys.exit(130)
    except InputError as error:
        print(f"{this.name}: error: {error}", file=sys.stderr)
        sys.exit(InputError.EXIT_CODE)
    except Exception as error:
        remedy = os_error_line(error) if isinstance(error, OSError) else None
        if remedy:
            print(f"{this.name}: error: {remedy}", file=sys.stderr)
        else:
            traceback.print_exc()
        sys.exit(1)
    finally:
        sys.stderr = terminal
        if log:
            with suppress(OSError):
                log.close()


def leave_note(this: Job, cost: dict[str, float]) -> None:
    """Write the note of this job, for `coronaryuq explain`."""
    resources = {"threads": this.threads, "mpi_ranks": this.size, **cost}
    snakefile = os.environ.get(shipped.VARIABLE) or shipped.snakefile()
    write_note(this.name, this.input, this.output, this.params, resources, snakefile)


def _from_snakemake(snakemake) -> Job:
    return Job(
        input={name: _paths(value) for name, value in snakemake.input.items()},
        output={name: _paths(value) for name, value in snakemake.output.items()},
        params=dict(snakemake.params.items()),
        threads=snakemake.threads,
        log=snakemake.log[0] if len(snakemake.log) else None,
        name=" ".join([snakemake.rule, *map(str, snakemake.wildcards)]),
        mpi=snakemake.resources.get("mpi", LOCAL_MPIEXEC),
        tasks=snakemake.resources.get("tasks", 1),
    )


def _paths(value) -> Any:
    return str(value) if isinstance(value, str) else [str(path) for path in value]


def _from_command_line() -> Job:
    parser = argparse.ArgumentParser(formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--input", nargs="*", default=[], metavar="NAME=PATH")
    parser.add_argument("--output", nargs="*", default=[], metavar="NAME=PATH")
    parser.add_argument("--params", default="{}", help="JSON object")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--ranks", type=int, default=1, help="MPI ranks of this job, if mpiexec or srun started it")
    parser.add_argument("--log")
    parser.add_argument("--name", help="name of the job in its note; default: the function's")
    args = parser.parse_args()
    params = json.loads(args.params)
    name = args.name or params.get("function", "stage").rpartition(":")[2]
    return Job(_pairs(args.input), _pairs(args.output), params, args.threads, args.log, name, size=args.ranks)


def _pairs(items: list[str]) -> dict[str, Any]:
    pairs: dict[str, Any] = {}
    for item in items:
        name, _, path = item.partition("=")
        if not path:
            continue
        if name in pairs:
            pairs[name] = [*(pairs[name] if isinstance(pairs[name], list) else [pairs[name]]), path]
        else:
            pairs[name] = path
    return pairs
