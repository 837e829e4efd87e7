"""The page of a search says what the answer says."""

import pytest

from coronaryuq.report.discrepancy import _named, _probability


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


def test_sizes_of_a_table_model_have_their_intervals():
    interval = {"size": 0.27, "size_low": 0.24, "size_high": 0.29}
    answer = {**LOSS, "class": [LOSS], "formula": "", "source": "", "size": interval | {"of": "the root's pressure"}}
    answer["terms"] = [{"term": "quadratic", "unit": "mmHg s2/mL2", "size": 4.01, "size_low": 3.5, "size_high": 4.5}]
    said = "0.27 (0.24 to 0.29) of the root's pressure, quadratic 4.01 (3.5 to 4.5) mmHg s2/mL2"
    assert _named(answer)["sizes"] == said
