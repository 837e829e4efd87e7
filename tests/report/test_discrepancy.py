"""The page of a search shows what its answer says."""

import json
import re
from pathlib import Path

import pytest
from markupsafe import escape

from coronaryuq.discrepancy.result.phrases import next_measurement_text
from coronaryuq.report import discrepancy
from coronaryuq.report.captions import SEARCHES
from coronaryuq.report.discrepancy import title, write_page

LOSS = {"effect": "loss", "place": "lad", "probability": 0.4}
FRICTION = {"effect": "friction", "place": "lad", "probability": 0.59}
INTERVAL = {"size": 0.27, "size_low": 0.24, "size_high": 0.29}
TERM = {"term": "quadratic", "unit": "mmHg s2/mL2", "size": 4.01, "size_low": 3.5, "size_high": 4.5}
PAIRS = {"formula": "", "source": "", "size": INTERVAL | {"of": "the root pressure"}, "terms": [TERM]}
"""What an answer of a table model says of an effect, besides its class."""


@pytest.fixture
def cells(tmp_path):
    """Write the page of an answer that names one effect; return the cells of its table."""

    def write(effect, branches=()):
        folder = tmp_path / "pairs" / "found"
        folder.mkdir(parents=True)
        answer = {"gap_unit": "FFR", "paragraph": "", "named": [effect], "held_out": {"branches": list(branches)}}
        (folder / "discrepancy.json").write_text(json.dumps(answer))
        write_page([str(folder / "discrepancy.json")], [], "smoke", {}, tmp_path / "page.html")
        return re.findall(r"<td[^>]*>(.*?)</td>", (tmp_path / "page.html").read_text())

    return write


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        ({**LOSS, "class": [LOSS], "class_probability": 0.4}, "0.40"),
        ({**LOSS, "class": [LOSS, FRICTION], "class_probability": 0.99}, "0.99, of this member 0.40"),
        ({**LOSS, "class": [LOSS, FRICTION], "probability": 0.99}, "0.99, of this member 0.40"),
    ],
    ids=["alone", "a class", "a class of a table model, whose probability is that of the answer"],
)
def test_the_probability_of_a_class_and_of_its_member_are_shown(cells, answer, text):
    assert cells(PAIRS | answer)[2] == text


def test_sizes_of_a_table_model_have_their_intervals(cells):
    text = "0.27 (0.24 to 0.29) of the root pressure, quadratic 4.01 (3.5 to 4.5) mmHg s2/mL2"
    assert cells(PAIRS | LOSS | {"class": [LOSS]})[3] == text


def test_pairs_show_the_law_and_how_it_changes_the_prediction(cells, tmp_path):
    said = {"median": 0.9, "low": 0.85, "high": 0.95, "at_most": {"0.75": 0.0, "0.80": 0.034}}
    branch = {
        "branch": "lcx", "place": "v:J", "effects": ["loss"], "coefficients": {"linear": 3.548, "quadratic": 9.9},
        "recalibration": {"own": 1.7},
        "ffr_rmse": dict.fromkeys(("before", "recalibration_alone", "after", "flexible"), 0.1),
        "prediction": {
            **dict.fromkeys(("simulated", "recalibrated", "measured"), said), "repaired": said | {"median": 0.8},
        },
    }  # fmt: skip
    cells(PAIRS | LOSS | {"class": [LOSS]}, [branch])
    text = (tmp_path / "page.html").read_text()
    assert "LCx: pressure lost is 1.7 × the model&#39;s own loss + 3.55 Q + 9.9 Q²" in text
    assert "<td>With the named effects</td><td>0.800 (0.850 to 0.950)</td><td>0 %</td><td>3 %</td>" in text
    assert text.count("0.900 (0.850 to 0.950)") == 3


def test_every_figure_says_what_to_see_what_is_good_and_what_is_bad(tmp_path):
    folder = tmp_path / "pairs"
    (folder / "found").mkdir(parents=True)
    (folder / "figures").mkdir()
    answer = {"gap_unit": "FFR", "paragraph": "", "named": [], "held_out": {"branches": []}}
    (folder / "found" / "discrepancy.json").write_text(json.dumps(answer))
    figures = [folder / "figures" / f"{name}.png" for name in SEARCHES]
    for figure in figures:
        figure.write_bytes(b"")
    answers = [str(folder / "found" / "discrepancy.json")]
    write_page(answers, list(map(str, figures)), "smoke", {}, tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert "<h1>Missing effects</h1>" in text
    for caption in SEARCHES.values():
        said = (caption.title, caption.see, caption.good, caption.bad, caption.then)
        assert all(said) and all(str(escape(words)) in text for words in said)


@pytest.mark.parametrize("nats", [0.05, 0.5])
def test_the_table_names_a_measurement_only_where_the_paragraph_does(cells, nats):
    """One that distinguishes nothing stood in the table, beside "No mean pressure or flow would distinguish them"."""
    measured = {"quantity": "flow", "location": "a", "condition": "rest", "statistic": "mean"}
    best = [measured | {"already_measured": False, "expected_information_nats": nats}]
    named = "would distinguish them best" in next_measurement_text(best)
    shown = cells(PAIRS | LOSS | {"class": [LOSS, FRICTION], "next_measurements": best})[4]
    assert named == ("distinguishable by mean flow at a under rest" in shown) == (nats > 0.1)


@pytest.mark.parametrize(
    ("invented", "heading"),
    [([True], "Self-test of the search"), ([False], "Missing effects"), ([True, False], "Missing effects")],
)
def test_invented_effects_are_not_headed_as_missing_ones(invented, heading):
    assert title([{"invented": one} for one in invented]) == heading


@pytest.mark.parametrize(
    "template", sorted(Path(discrepancy.__file__).parent.glob("*.html")), ids=lambda path: path.name
)
def test_every_table_scrolls_in_itself_on_a_narrow_screen(template):
    text = template.read_text()
    assert len(re.findall(r"<table\b", text)) == len(re.findall(r'<div class="wide"><table\b', text))
