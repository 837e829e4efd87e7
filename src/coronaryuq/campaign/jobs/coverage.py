"""Measure the coverage of the intervals at one pilot size."""

from coronaryuq.bench.estimation import coverage
from coronaryuq.core.io.atomic import write_json
from coronaryuq.estimation.analysis.paper_table import published


def coverage_of_size(data: str | None, size: int, trials: int, cells: str) -> None:
    """Measure the coverage on analytic pairs and, if `data` is given, on the published runs."""
    folder, rows = map(str, published(data)) if data else (None, None)
    write_json(cells, coverage.run(data=folder, rows=rows, trials=trials, sizes=(size,)))
