"""Quality of the 3D runs for the engineer: each measure with its limit beside it."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.core.records import Record, read


@dataclass(frozen=True)
class Measure:
    """A number of every run's diagnostics. most: the limit, None for one that only informs."""

    key: str
    name: str
    digits: str
    most: float | None = None


def quality(batches: Sequence[str], tolerance: float) -> list[dict]:
    """Return a line per measure of the runs that succeeded: name, median, worst, limit, verdict.

    Parameters
    ----------
    batches
        Records of the 3D runs, JSON lines.
    tolerance
        Largest change of any quantity between the last two cycles at which a run counts as converged.
    """
    runs = [record for path in batches for record in read(path) if record.ok]
    measures = (
        Measure("change", "Change of the quantities between the last two cycles", ".2g", tolerance),
        Measure("mass_balance", "Mass balance: difference of in- and outflow over the inflow", ".1g", 1e-6),
        Measure("momentum_unconverged_steps", "Time steps whose momentum equation did not converge", ".0f", 0.0),
        Measure("backflow_steps", "Time steps with backflow through an outlet", ".0f"),
        Measure("cycles", "Cardiac cycles", ".0f"),
        Measure("steps_per_cycle", "Time steps per cycle", ".0f"),
        Measure("cfl", "CFL number, largest (implicit: no limit)", ".0f"),
    )
    return [line for measure in measures if (line := _line(measure, runs))]


def _line(measure: Measure, runs: Sequence[Record]) -> dict | None:
    values = np.array([float(str(run.diagnostics[measure.key])) for run in runs if measure.key in run.diagnostics])
    if not len(values):
        return None
    met = measure.most is None or values.max() <= measure.most
    within = int((values <= measure.most).sum()) if measure.most is not None else len(values)
    return {
        "name": measure.name,
        "median": _shown(np.median(values), measure.digits),
        "worst": _shown(values.max(), measure.digits),
        "limit": "–" if measure.most is None else _shown(measure.most, "g"),
        "verdict": "" if measure.most is None else f"{within} of {len(values)} runs within",
        "class": "" if measure.most is None else "good" if met else "warn",
    }


def _shown(value: float, digits: str) -> str:
    """Format a number; a line of a narrow table may break at a hyphen, so that powers of ten have a minus sign."""
    return re.sub(r"e-0?", "e\u2212", f"{value:{digits}}")
