"""The paragraph of a search says what its answer is."""

from coronaryuq.discrepancy.result import summary_text
from coronaryuq.discrepancy.selection.answer import NAMES, OTHER, UNLISTED


def told(form):
    """What the paragraph says of two errors of one device if the answer is something else."""
    best = [{"effect": name, "place": "a:b", "implausible": False} for name in ("pressure_low_pass", "pressure_delay")]
    gaps = {"before": {"misfit": 1.9}, "after": {"misfit": 1.1}, "scheme": "declared", "conditions": ["x"]}
    answer = {
        "held_out": gaps,
        "wiring_errors": [],
        "facts": {"best": best, "answer": form},
        "held_out_conditions": ["x"],
    }
    return summary_text._outside_library(answer, ["x"])


def test_the_device_of_an_unlisted_response_is_told():
    form = {"probabilities": {NAMES: 0.02, OTHER: 0.98}, "leading_form": UNLISTED, "device": "pressure at a:b"}
    assert told(form).startswith(
        "Something other than an effect of the library is missing (probability 0.98): the best candidates are pressure "
        "low pass at a:b and pressure delay at a:b, but one linear response of the device that reads pressure at a:b, "
        "of a shape that the library does not list, is likelier. No effect is named. "
    )
