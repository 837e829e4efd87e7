"""The results of campaigns in some lines: FFR of each lesion, and how two campaigns differ."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coronaryuq.case.case_json import read_case
from coronaryuq.core.errors import InputError
from coronaryuq.estimation.results import Probability, RowReport, read_estimates
from coronaryuq.report.quantities import Percent

ESTIMATES = "estimation/estimates.json"
CASE = "case/case.json"


@dataclass(frozen=True)
class Answer:
    """FFR of one lesion.

    median, low, high: of the patient, 90 % range. limit: of the highest zone; below: probability of FFR up to it, in
    words, with its interval. mean, std: of FFR, with its standard error. runs: 3D runs. The first five are None where
    they were not estimated.
    """

    lesion: str
    median: float | None
    low: float | None
    high: float | None
    limit: float | None
    below: str | None
    mean: float
    std: float
    runs: int

    def __str__(self) -> str:
        if self.median is None:
            return f"{self.lesion}: mean FFR {self.mean:.3f} ± {self.std:.3f}"
        chance = "" if self.below is None else f", P(FFR ≤ {self.limit:.2f}) {self.below}"
        return f"{self.lesion}: FFR {self.median:.2f} ({self.low:.2f} to {self.high:.2f}, 90 % range){chance}"


def answers(home: str | Path) -> list[Answer]:
    """Return FFR of every lesion of a campaign.

    Raises
    ------
    InputError
        If the campaign has no estimates.
    """
    home = Path(home)
    if not (home / ESTIMATES).is_file():
        raise InputError(home, None, None, f"no {ESTIMATES} in it; name the results folder of a finished campaign")
    rows = read_estimates(home / ESTIMATES).rows
    names = [stenosis.name for stenosis in read_case(home / CASE).stenoses]
    of_lesion = {name: [row for row in rows if row.column_3d == f"ffr_{name.lower()}"] for name in names}
    return [_answer(name, found, Percent(rows)) for name, found in of_lesion.items() if found]


def _answer(lesion: str, rows: list[RowReport], percent: Percent) -> Answer:
    row = min(rows, key=lambda row: row.recommended_report.std)
    estimate, beyond = row.recommended_report, row.beyond_the_mean
    ranges, zones = beyond.predictive or {}, beyond.zones or []
    known = {"0.05", "0.50", "0.95"} <= set(ranges)
    median, low, high = (ranges[share] if known else None for share in ("0.50", "0.05", "0.95"))
    limit, below = (zones[-1].above, _chance(zones[-1].complement, percent)) if zones else (None, None)
    return Answer(lesion, median, low, high, limit, below, estimate.mean, estimate.std, estimate.n_3d)


def _chance(below: Probability, percent: Percent) -> str:
    return f"{percent(below)} ({percent.end(below.low).removesuffix(' %')} to {percent.end(below.high)})"


def compare(one: str | Path, other: str | Path) -> list[str]:
    """Return lines that compare two campaigns, lesion by lesion.

    A difference of means is given in standard errors of that difference, as if both campaigns were independent.
    """
    first, second = ({answer.lesion: answer for answer in answers(home)} for home in (one, other))
    lines = []
    for lesion in dict.fromkeys([*first, *second]):
        if lesion not in first or lesion not in second:
            lines.append(f"{lesion}: only in {one if lesion in first else other}")
            continue
        a, b = first[lesion], second[lesion]
        lines += [f"{one}  {a}", f"{other}  {b}"]
        error = float(np.hypot(a.std, b.std))
        ratio = f", {abs(b.mean - a.mean) / error:.1f} standard errors" if error else ""
        change = f"{b.mean - a.mean:+.3f}".replace("-", "−")
        lines.append(f"    mean FFR {a.mean:.3f} → {b.mean:.3f}: {change} ± {error:.3f}{ratio}")
    return lines
