"""Outcome of one sample: inputs, outputs, status, solver, cost; stored as JSON lines, one file per batch."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import json_default, write_text
from coronaryuq.core.io.text import parse_json

OK, FAILED = "ok", "failed"

STATE = ("chain", "draw")
"""Columns of tables of inputs that name the state of a Markov chain that a sample is; they are no inputs."""


@dataclass
class Record:
    """Outcome of one sample.

    Attributes
    ----------
    sample
        Name in the table of inputs.
    inputs
        θ: input → value.
    outputs
        Quantity → value; empty if the run failed.
    status
        "ok" or "failed".
    reason
        Why it failed, on one line.
    solver
        Name and version.
    cost
        `cpu_s`, `wall_s`, `cycles`, ...
    diagnostics
        Quality of the solution: CFL number, mass balance, backflow events.
    """

    sample: str
    inputs: dict[str, float]
    outputs: dict[str, float] = field(default_factory=dict)
    status: str = OK
    reason: str = ""
    solver: dict[str, str] = field(default_factory=dict)
    cost: dict[str, float] = field(default_factory=dict)
    diagnostics: dict[str, object] = field(default_factory=dict)

    @classmethod
    def failed(cls, sample: str, inputs: dict[str, float], reason: str, **rest) -> "Record":
        """Return the record of a failed run, with the reason on one line."""
        return cls(sample=sample, inputs=inputs, status=FAILED, reason=" ".join(str(reason).split()), **rest)

    @property
    def ok(self) -> bool:
        return self.status == OK


def write(path: str | Path, records: Iterable[Record]) -> None:
    """Write records as JSON lines, one per sample, in the given order."""
    lines = (json.dumps(asdict(record), ensure_ascii=False, default=json_default) for record in records)
    write_text(path, "".join(line + "\n" for line in lines))


def read(path: str | Path) -> list[Record]:
    """Read records.

    Raises
    ------
    InputError
        If the file is missing, empty, truncated or malformed; names the line.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file") from None
    except UnicodeDecodeError:
        raise InputError(path, None, None, "not a text file; delete it and run again") from None
    if not text.endswith("\n"):
        raise InputError(path, None, None, "empty or truncated records; delete it and run again")
    records = []
    for number, line in enumerate(text[:-1].split("\n"), start=1):
        try:
            records.append(_checked(Record(**parse_json(line))))
        except (ValueError, TypeError, RecursionError) as error:
            raise InputError(path, f"line {number}", None, f"not a record ({error}); delete it and run again") from None
    return records


def _checked(record: Record) -> Record:
    if record.status not in (OK, FAILED):
        raise ValueError(f"status {record.status!r} is neither {OK} nor {FAILED}")
    if not isinstance(record.sample, str) or not isinstance(record.reason, str):
        raise ValueError("sample and reason must be text")
    for name in ("inputs", "outputs", "cost"):
        values = getattr(record, name)
        if not isinstance(values, dict):
            raise ValueError(f"{name} is not a mapping")
        for key, value in values.items():
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"{name}.{key} = {value!r} is not a number")
    if not isinstance(record.solver, dict) or not isinstance(record.diagnostics, dict):
        raise ValueError("solver and diagnostics must be mappings")
    return record
