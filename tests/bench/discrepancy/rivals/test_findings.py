"""The sentences about the comparison with other methods say what its recorded cases say."""

import json
import re
from pathlib import Path

import pytest

from coronaryuq.bench.discrepancy.rivals.compare import OURS, compared, side_by_side
from coronaryuq.bench.discrepancy.rivals.findings import OUTSIDE, REGRESSION, SELECTION, TESTS, VIOLATED, findings

BENCHMARKS = Path(__file__).parents[4] / "benchmarks"


def recorded(name):
    return [json.loads(line) for line in (BENCHMARKS / name).read_text().splitlines()]


@pytest.fixture(scope="module")
def cases():
    return recorded("discrepancy-rivals.jsonl"), recorded("discrepancy-cases.jsonl")


def test_the_courses_at_the_level_used_give_the_recorded_answers(cases):
    """Right answers outside the library and under violated priors, from what each method tried, and as scored."""
    others, ours = cases
    rows = side_by_side(others, ours)
    table = compared(rows).set_index(["group", "method"])
    scored = [int(table.loc[([OUTSIDE, VIOLATED], method), "right"].sum()) for method in (SELECTION, REGRESSION, TESTS)]
    said = re.search(r"are right in (\d+), (\d+) and (\d+) of (\d+) cases", findings(rows, others, ours)[-1])
    assert said is not None and [int(number) for number in said.groups()[:3]] == scored
    assert int(said.group(4)) == int(table.loc[([OUTSIDE, VIOLATED], OURS), "cases"].sum())


def test_another_answer_changes_the_sentences(cases):
    """If our search had missed every case outside the library, they would say so."""
    others, ours = cases
    changed = [{**case, "abstained": False} if case["effect"].startswith("outside") else case for case in ours]
    now, before = (findings(side_by_side(others, case), others, case) for case in (changed, ours))
    assert "right in 0 of " in now[2] and now[0] != before[0]
