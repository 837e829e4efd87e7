"""What an answer says of the candidates of a round."""

from dataclasses import replace

import pytest

from coronaryuq.discrepancy.selection.answer import ALONE, MISWIRED, NAMES, NOTHING, OTHER
from support.discoveries import discovery
from support.linear_problem import here, made_up


def answered():
    """An effect at 0.6, with a wiring error that the data do not exclude at 0.3, and something else at 0.1."""
    found = discovery({made_up("found"): 1.0}, probability=0.6)
    (entry,) = found.rounds
    (effect,) = entry.members
    twin = replace(effect, placed=here("twin"), share=0.2)
    wiring = replace(effect, placed=here("wiring", nameable=False), share=0.3)
    members = [replace(effect, share=0.4), twin, wiring]
    entry = replace(entry, shortlist=members, members=members, accepted=members[0])
    given = replace(
        found.answer,
        probabilities={NAMES: 0.6, NOTHING: 0.0, OTHER: 0.4},
        forms={ALONE: 0.1, MISWIRED: 0.3},
    )
    return replace(found, rounds=(entry,), answer=given), entry


def test_a_wiring_error_is_no_member_of_a_named_class_and_counts_once():
    found, entry = answered()
    accepted, twin, wiring = entry.members
    assert found.probability(entry, accepted) == pytest.approx(0.4)
    assert found.probability(entry, twin) == pytest.approx(0.2)
    assert found.probability(entry, wiring) == pytest.approx(0.3)
    assert found.class_probability(entry) == pytest.approx(0.6)
    assert [c.effect.name for c in entry.effects] == ["found", "twin"]


def test_candidates_whose_shares_are_below_the_smallest_number_are_impossible():
    found, entry = answered()
    gone = [replace(c, share=0.0 if c.effect.nameable else 1.0) for c in entry.members]
    entry = replace(entry, shortlist=gone, members=gone)
    assert [found.probability(entry, c) for c in gone] == [0.0, 0.0, pytest.approx(0.3)]
