"""The figure of an unknown source shows its waveform by condition, or says that there is none."""

import matplotlib.pyplot as plt
import pandas as pd
import pytest

from coronaryuq.figures import flow_source as drawn


@pytest.fixture
def axes_of(tmp_path, monkeypatch):
    def draw(frame: pd.DataFrame):
        frame.to_csv(tmp_path / "t.csv", index=False)
        monkeypatch.setattr(plt, "close", lambda figure: None)
        drawn.flow_source(tmp_path / "t.csv", tmp_path / "t.png")
        assert (tmp_path / "t.png").stat().st_size > 1000
        return plt.gcf().axes

    yield draw
    monkeypatch.undo()
    plt.close("all")


def test_every_condition_has_a_line_and_a_band(axes_of):
    row = {"phase": [0.0, 0.5], "flow": [0.1, 0.3], "low": [0.0, 0.2], "high": [0.2, 0.4], "vessel": "lad"}
    (axis,) = axes_of(pd.concat([pd.DataFrame(row | {"condition": name}) for name in ("rest", "stress")]))
    labels = [line.get_label() for line in axis.get_lines()][:2]
    assert labels == ["rest", "stress"] and len(axis.collections) == 2
    assert axis.get_ylabel() == "flow that leaves at lad\n(mL/s; negative: blood enters)"


def test_without_a_source_the_figure_says_so(axes_of):
    (axis,) = axes_of(pd.DataFrame(columns=drawn.COLUMNS))
    assert [text.get_text() for text in axis.texts] == ["no unknown source was sought, or none explains anything"]
