"""The figure of a pullback shows readings, the model before and after, vessels, and where effects act."""

from contextlib import contextmanager

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.units import MMHG
from coronaryuq.figures import pullback as drawn


@pytest.fixture
def axes_of(monkeypatch, tmp_path):
    """Draw a table and return what is on each of its axes."""
    collected = []
    original = drawn.saved

    @contextmanager
    def saved(output, **options):
        with original(output, **options) as (canvas, axes):
            yield canvas, axes
            for axis in axes.flat:
                lines = {line.get_label(): line.get_ydata() for line in axis.lines}
                words = [text.get_text() for text in axis.texts]
                spans = [patch.get_extents().transformed(axis.transData.inverted()) for patch in axis.patches]
                collected.append((axis.get_title(), axis.get_ylabel(), words, lines, spans))

    monkeypatch.setattr(drawn, "saved", saved)

    def draw(frame):
        frame.to_csv(tmp_path / "t.csv", index=False)
        drawn.pullback(tmp_path / "t.csv", tmp_path / "t.png")
        assert (tmp_path / "t.png").read_bytes()[:4] == b"\x89PNG"
        return collected

    return draw


def table(quantity="pullback pressure", unit=MMHG, **changes):
    x = np.arange(0.0, 60.0, 10.0)
    frame = {
        "condition": "stress", "quantity": quantity, "location": "lm>lad", "statistic": "mean", "distance_mm": x,
        "measured": unit * (90.0 - x), "sd": unit, "recalibrated": unit * 90.0, "repaired": unit * (91.0 - x),
        "vessel": ["lm"] * 3 + ["lad"] * 3, "acting": ["", "", "", "focal_stenosis", "focal_stenosis", ""],
        "named": True,
    }  # fmt: skip
    return pd.DataFrame(frame | changes)


def test_readings_models_vessels_and_the_place_of_the_effect_are_drawn(axes_of):
    ((title, label, words, lines, spans),) = axes_of(table())
    assert title == "pullback along lm>lad under stress" and label == "mean pressure (mmHg)"
    assert words == ["focal stenosis", "lm", "lad"]
    assert lines["recalibrated"] == pytest.approx(np.full(6, 90.0))
    assert lines["with the named effects"] == pytest.approx(91.0 - np.arange(0.0, 60.0, 10.0))
    assert (spans[0].x0, spans[0].x1) == pytest.approx((25.0, 45.0))


def test_a_ratio_has_the_line_of_significance(axes_of):
    (rest, stress) = axes_of(pd.concat([table(condition="rest"), table("pullback ratio", 0.01, named=False)]))
    assert "0.80" not in rest[2] and "0.80" in stress[2] and stress[1] == "Pd/Pa"
    assert any(np.allclose(values, 0.8) for values in stress[3].values())


def test_without_a_pullback_the_figure_says_so(axes_of):
    ((*_, words, _, _),) = axes_of(table().iloc[:0])
    assert words == ["no pullback was measured"]
