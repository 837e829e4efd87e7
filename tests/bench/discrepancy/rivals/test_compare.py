"""Answers of rivals beside ours."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.rivals.compare import OURS, ahead, compared, outcome, side_by_side
from coronaryuq.bench.discrepancy.score import matches
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect
from coronaryuq.zerod.effects.library import effect

GAIN, DELAY = ("flow_gain", "a"), ("flow_delay", "a")
HIDDEN = Hypothesis((PlacedEffect(effect("flow_gain"), "a"),))


def entry(hidden, classes=(), alarmed=False, name="flow_gain", noise="nominal", seed=1):
    cell = {"network": "open loop", "effect": name, "strength": "medium", "noise": noise, "seed": seed}
    return cell | matches(hidden, list(classes), alarmed) | {"probability": None, "cpu_s": 1.0}


def test_outcomes_of_answers():
    assert outcome(entry(HIDDEN, [[GAIN, DELAY]], True)) == "right"
    assert outcome(entry(HIDDEN, [[DELAY], [GAIN]], True)) == "wrong name", "the hidden effect is not the first"
    assert outcome(entry(HIDDEN, [[("flow_gain", "b")]], True)) == "wrong name", "another place"
    assert outcome(entry(HIDDEN, [], True)) == outcome(entry(HIDDEN)) == "missed"
    assert outcome(entry(PLAIN, [], True, "none")) == "false alarm"
    assert outcome(entry(PLAIN, [], False, "none")) == "right"
    assert outcome(entry(PLAIN, [], True, "outside:x")) == "right"
    assert outcome(entry(PLAIN, [[GAIN]], True, "outside:x")) == "wrong name"
    assert outcome(entry(PLAIN, [], False, "outside:x")) == "missed"


def rival_entry(**answers):
    one = next(iter(answers.values()))
    return {name: one[name] for name in ("network", "effect", "strength", "noise", "seed")} | {"answers": answers}


def test_only_cases_that_both_have_are_compared_and_each_in_its_group():
    theirs = [
        rival_entry(x=entry(HIDDEN, [[GAIN], [DELAY]], True), y=entry(HIDDEN)),
        rival_entry(x=entry(PLAIN, name="none", seed=2), y=entry(PLAIN, [], True, "none", seed=2)),
        rival_entry(x=entry(HIDDEN, seed=3), y=entry(HIDDEN, seed=3)),
        {"network": "open loop", "effect": "flow_gain", "seed": 4, "skipped": True},
    ]
    ours = [entry(HIDDEN, [[GAIN]], True), entry(PLAIN, name="none", seed=2), {"effect": "none", "skipped": True}]
    table = compared(side_by_side(theirs, ours)).set_index(["group", "method"])
    assert table.loc[("one effect", OURS), ["cases", "right", "alone"]].tolist() == [1, 1, 1]
    assert table.loc[("one effect", "x"), ["cases", "right", "alone"]].tolist() == [1, 1, 0], "it names one more"
    assert table.loc[("one effect", "y"), ["right", "missed"]].tolist() == [0, 1]
    assert table.loc[("nothing", "y"), "false alarm"] == 1
    assert table.loc[("all cases", "y"), ["cases", "right", "missed", "false alarm"]].tolist() == [2, 0, 1, 1]


def test_paired_difference_of_right_answers():
    """Agresti & Min (2005): pairs of 10 and 2 of 50 that only one method has right."""
    rows = []
    for seed in range(50):
        ours, theirs = seed >= 2, not 2 <= seed < 12
        rows += [entry(HIDDEN, [[GAIN]] if right else [], right, seed=seed) | {"method": m}
                 for m, right in ((OURS, ours), ("x", theirs))]  # fmt: skip
    (found,) = ahead(rows)
    assert (found["only_ours"], found["only_theirs"]) == (10, 2) and found["difference"] == pytest.approx(8 / 50)
    error = 1.96 * np.sqrt((10.5 + 2.5 - 8.0**2 / 52) / 52**2)
    assert (found["low"], found["high"]) == pytest.approx((8 / 52 - error, 8 / 52 + error))


def test_differences_weighted_to_the_proportions_of_other_cases():
    """A group of which the sample has a third counts as its half of all cases; alike groups count as one."""
    hidden = [(HIDDEN, "flow_gain", [[GAIN]], True)] * 20 + [(PLAIN, "none", [], False)] * 40
    rows = []
    for seed, (truth, name, answer, alarmed) in enumerate(hidden):
        for method in (OURS, "x"):
            wrong = method == "x" and name == "flow_gain" and seed % 2 == 0
            rows.append(entry(truth, [] if wrong else answer, alarmed, name, seed=seed) | {"method": method})
    every = [entry(HIDDEN)] * 5 + [entry(PLAIN, name="none")] * 5
    (found,), (plain,) = ahead(rows, every), ahead(rows)
    assert (plain["difference"], found["difference"]) == (pytest.approx(10 / 60), pytest.approx(0.5 * 10 / 20))
    assert (found["only_ours"], found["only_theirs"]) == (10, 0)
    half = found["high"] - found["low"], plain["high"] - plain["low"]
    assert half[0] > half[1] and found["low"] < found["difference"] < found["high"]
    (same,) = ahead([row for row in rows if row["effect"] == "none"], every)
    assert same["difference"] == 0.0
