"""Parts of a 0D network have the names of the arteries on the page."""

from coronaryuq.case.anatomy.network_names import InWords

IN_WORDS = InWords({"branch2": "LAD", "rca6": "PL1"}, {"BC_rca6": "PL1"})


def test_vessels_beds_and_places_have_readable_names():
    told = IN_WORDS(
        {"text": "pressure at rca6:BC_rca6, the resistance of BC_rca6", "rows": ["flow at J0:branch2_seg0"]}
    )
    assert told == {
        "text": "pressure at the end of PL1, the resistance of the PL1 bed",
        "rows": ["flow at LAD (part 1)"],
    }
    assert IN_WORDS("loss at branch2_seg1:J7") == "loss at LAD (part 2)"
    assert IN_WORDS("quadratic stenosis at rca6 (loss 0.332)") == "quadratic stenosis at PL1 (loss 0.332)"


def test_other_words_and_pictures_stay():
    found = {"data": "data:image/png;base64,branch2_seg0", "caption": "Score: 3.2 at 0:5", "number": 4}
    assert IN_WORDS(found) == found
