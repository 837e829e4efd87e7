"""The first patients with three, two and one stenoses: whole campaigns whose ranges are judged by the truth."""

import pytest
from scipy.stats import binom

from coronaryuq.bench.endtoend.benchmark import run
from coronaryuq.bench.endtoend.patients import draw

SEED = 1
LEVEL = 0.95
CHANCE = 0.001
"""Probability that ranges which hold what they state fail, if stenoses were independent."""
GUESS = 0.25
"""Brier score of the statement 0.5."""


def first_with(stenoses: int) -> int:
    return next(index for index in range(100) if len(draw(SEED, index, 1.0).lesions) == stenoses)


@pytest.mark.long
@pytest.mark.workflow
def test_ranges_hold_the_truth_of_a_handful_of_patients(tmp_path):
    file, found = tmp_path / "patients.jsonl", []
    for count in (3, 2, 1):
        result = run(first=first_with(count), patients=1, seed=SEED, setting="full", cores=2, resume=str(file))
        assert (result["failed"], result["vessels"]) == (0, count)
        found += [vessel["ffr"] for line in result["lines"] for vessel in line["vessels"].values()]
    held = [one["quantiles"]["0.025"] <= one["truth"] <= one["quantiles"]["0.975"] for one in found]
    assert len(found) - sum(held) <= binom.ppf(1 - CHANCE, len(found), 1 - LEVEL)
    assert sum((one["below"] - (one["truth"] <= 0.8)) ** 2 for one in found) / len(found) < GUESS
