"""Compare a search with the hidden truth, and run one portion of its benchmark."""

from pathlib import Path

from coronaryuq.bench.discrepancy import benchmark
from coronaryuq.core.io.atomic import write_json
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.discrepancy.stage import compare


def compare_with_truth(
    model: str, measurements: str, conditions: str, truth: str, gaps: str, answer: str, settings: Settings, seed: int,
    table: str, reference: str, threads: int,
) -> None:  # fmt: skip
    """Write the held-out gap with the true effect next to those of a search to which it was unknown."""
    case = {"model": model, "measurements": measurements, "conditions": conditions}
    found, out = {"gaps": gaps, "answer": answer}, {"table": table, "reference": reference}
    compare(case, truth, found, settings, seed, out, threads=threads)


def benchmark_of_seed(name: str, seed: int, threads: int, cases: str, network: str | None = None) -> None:
    """Hide effects in a network, one case per cell, and search for them; an interrupted run continues."""
    finished = Path(cases).with_suffix(".finished.jsonl")
    # Our engine makes the data: a campaign does not depend on whether svZeroDSolver is installed.
    chosen = {"network": network, "offset": seed, "name": name, "threads": threads, "nature": "own"}
    found = benchmark.run(quick=False, resume=finished, **chosen)
    write_json(cases, found)
    finished.unlink()
