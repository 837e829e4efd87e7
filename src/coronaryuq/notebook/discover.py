"""The search for a missing effect from Python."""

import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.result.summary_text import write_paragraph
from coronaryuq.discrepancy.search_case import search_case
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.discrepancy.table_model.search import discover_pairs


def discover(
    model: str | Path | None = None,
    measurements: str | Path | None = None,
    conditions: str | Path | None = None,
    *,
    pairs: tuple[str | Path, str | Path] | None = None,
    out: str | Path | None = None,
    seed: int = 1,
    settings: Settings | None = None,
) -> dict[str, Any]:
    """Find the physical effect that a model is missing, as `coronaryuq discrepancy` does.

    Parameters
    ----------
    model, measurements, conditions
        Network (svZeroDSolver JSON), measurement table (CSV), conditions file (YAML); see docs/how-to/discrepancy.md.
    pairs
        Instead of these: tables of simulated and of measured outputs.
    out
        Folder for all results; None: only the answer is returned.
    seed
        Seed of cross-validation folds and intervals.
    settings
        Settings of the search.

    Returns
    -------
    dict
        Content of `discrepancy.json`; `paragraph` is the result in words.

    Raises
    ------
    InputError
        If a file is missing or invalid, before anything is written.
    """
    given = {"model": model, "measurements": measurements, "conditions": conditions}
    if pairs is not None and any(given.values()):
        raise InputError("discover", "pairs", None, "cannot be combined with model, measurements and conditions")
    missing = [name for name, value in given.items() if not value]
    if pairs is None and missing:
        raise InputError("discover", missing[0], None, "missing; or give pairs")
    with tempfile.TemporaryDirectory() if out is None else nullcontext(str(out)) as folder:
        if pairs is not None:
            return discover_pairs(*pairs, out_dir=Path(folder), seed=seed)
        answer = search_case(*given.values(), Path(folder), settings or Settings(), seed)
        paragraph = write_paragraph(Path(folder, "discrepancy.json"), Path(folder, "paragraph.txt"))
        return answer | {"paragraph": paragraph}
