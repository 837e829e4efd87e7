"""The page of a search says what the answer says."""

import pytest

from coronaryuq.report.discrepancy import _probability


def member(effect, probability):
    return {"effect": effect, "place": "lad", "probability": probability}


LOSS, FRICTION = member("loss", 0.4), member("friction", 0.59)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ({**LOSS, "class": [LOSS], "class_probability": 0.4}, "0.40"),
        ({**LOSS, "class": [LOSS, FRICTION], "class_probability": 0.99}, "0.99, of this member 0.40"),
        ({**LOSS, "class": [LOSS, FRICTION], "probability": 0.99}, "0.99, of this member 0.40"),
    ],
    ids=["alone", "a class", "a class of a table model, whose probability is the answer's"],
)
def test_the_probability_of_a_class_is_told_from_that_of_the_member(answer, said):
    assert _probability(answer) == said
