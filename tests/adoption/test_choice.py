"""What is adopted of an answer: what was named and improves the prediction of data held out, class members mixed."""

import pytest

from coronaryuq.adoption.choice import chosen


def member(name, probability, side="network", sizes=1):
    eye = [[float(i == j) for j in range(sizes)] for i in range(sizes)]
    standard = {"mean": [0.1] * sizes, "covariance": eye}
    return {"effect": name, "place": "lca1", "probability": probability, "side": side, "standard_sizes": standard}


def answer(*classes, given="names", after=-5.0, probability=0.9):
    held = {when: {"log_predictive_density_per_row": x} for when, x in (("before", -6.0), ("after", after))}
    named = [{"class": list(members)} for members in classes]
    return {
        "named": named,
        "held_out": held,
        "facts": {"answer": {"given": given, "probabilities": {"names": probability}}},
    }


@pytest.mark.parametrize("given", ["nothing", "something else"])
def test_an_answer_without_a_name_adopts_nothing_and_says_so(given):
    choice = chosen(answer(given=given))
    assert choice.classes == [] and given in choice.reason


def test_a_name_that_data_kept_out_do_not_confirm_is_not_adopted():
    choice = chosen(answer([member("quadratic_stenosis", 0.9)], after=-6.1))
    assert choice.classes == [] and "held out" in choice.reason and "-6.10" in choice.reason


def test_a_name_that_is_not_probable_enough_is_not_adopted():
    choice = chosen(answer([member("quadratic_stenosis", 0.7)], probability=0.7))
    assert choice.classes == [] and "0.70" in choice.reason and "0.80" in choice.reason


def test_members_of_a_class_are_mixed_by_their_probabilities_and_the_least_probable_left_out():
    members = [member("diffuse_narrowing", 0.2), member("quadratic_stenosis", 0.6), member("ostial_loss", 0.001)]
    other = [member("pressure_offset", 0.8, "measurement")]
    choice = chosen(answer(members, other))
    first, second = choice.classes
    assert [one.effect for one in first] == ["quadratic_stenosis", "diffuse_narrowing"]
    assert [one.probability for one in first] == pytest.approx([0.75, 0.25])
    assert [one.measurement for one in second] == [True] and choice.reason == ""
