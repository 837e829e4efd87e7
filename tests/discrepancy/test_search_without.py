"""A second search without an effect that is easily taken for others: when it is made, and which of the two stands."""

from types import SimpleNamespace

import pytest

from coronaryuq.discrepancy.selection import search
from support.hypotheses import assume, placed
from support.linear_problem import made_up

DRIVE, PROBE, LOSS = made_up("drive_gain"), made_up("flow_gain", is_measurement_error=True), made_up("loss")
LIBRARY = (DRIVE, PROBE, LOSS)


def found(named=(), far_out=(), log_weight=0.0):
    rounds = [SimpleNamespace(accepted=SimpleNamespace(effect=one)) for one in named]
    return SimpleNamespace(named=rounds, far_out=[placed(one, "here") for one in far_out], log_weight=log_weight)


def searched(monkeypatch, first, second):
    """What stands of a search that finds `first`, and `second` without an effect; and which effect that was."""
    left_out = []

    def one(problem, seed, library, report):
        gone = set(LIBRARY) - set(library)
        left_out.extend(effect.name for effect in gone)
        return second if gone else first

    monkeypatch.setattr(search, "_search", one)
    return search._with_and_without(None, 1, LIBRARY, lambda line: None), left_out


@pytest.mark.parametrize("likelier", [True, False])
@pytest.mark.parametrize(
    ("given", "without"), [({"named": [LOSS, DRIVE]}, "drive_gain"), ({"far_out": [LOSS, PROBE]}, "flow_gain")]
)
def test_the_likelier_of_both_stands(monkeypatch, given, without, likelier):
    first, second = found(**given), found([LOSS], log_weight=1.0 if likelier else -1.0)
    stands, left_out = searched(monkeypatch, first, second)
    assert left_out == [without] and stands is (second if likelier else first)


@pytest.mark.parametrize("given", [{"named": [LOSS, PROBE]}, {"far_out": [LOSS]}, {}])
def test_others_need_no_second_search(monkeypatch, given):
    first = found(**given)
    stands, left_out = searched(monkeypatch, first, found(log_weight=9.0))
    assert stands is first and not left_out


@pytest.mark.parametrize(("held_out", "weight"), [(True, -10.0 - 2.0 + 4.0), (False, -10.0 - 2.0)])
def test_a_weight_counts_no_measurement_twice(held_out, weight):
    """Evidence, the class's share of the prior, and the density of measurements that were kept out, if any were."""
    loss = placed(LOSS, "here")
    conditions = {"rest": SimpleNamespace(held_out=False), "pacing": SimpleNamespace(held_out=held_out)}
    answer = SimpleNamespace(
        hypothesis=assume(loss),
        rounds=[SimpleNamespace(accepted=SimpleNamespace(placed=loss), class_log_prior=-2.0)],
        problem=SimpleNamespace(forward=SimpleNamespace(conditions=conditions)),
        fit=SimpleNamespace(evidence=-10.0),
        gaps=SimpleNamespace(after=SimpleNamespace(total_lpd=4.0)),
    )
    assert search.Discovery.log_weight.fget(answer) == weight
