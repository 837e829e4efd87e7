"""The figures of a search are drawn from its tables only, also if nothing was named."""

import re
from contextlib import contextmanager

import numpy as np
import pandas as pd
import pytest

from coronaryuq.case.settings import Settings
from coronaryuq.case.stage import prepare_case
from coronaryuq.core.units import MBF_PER_MIN_PER_G, ML_PER_MIN, MMHG
from coronaryuq.figures import discrepancy as drawn
from coronaryuq.figures.draw import draw
from support.case_files import small_tree, write_case


def is_png(path):
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def kept(monkeypatch):
    """Collect titles, labels, texts and lines of a figure's axes when it is saved."""
    collected = []
    original = drawn.saved

    @contextmanager
    def saved(output, **options):
        with original(output, **options) as (canvas, axes):
            yield canvas, axes
            for axis in np.atleast_1d(axes).flat:
                lines = {tuple(map(tuple, line.get_xydata())) for line in axis.lines}
                words = [text.get_text() for text in axis.texts]
                collected.append((axis.get_title(), axis.get_xlabel(), axis.get_ylabel(), words, lines))

    monkeypatch.setattr(drawn, "saved", saved)
    return collected


def test_the_tree_shows_all_vessels_and_the_named_effects_at_their_places(tmp_path, kept):
    frame = {"vessel": ["a", "b", "c"], "parent": ["", "a", "a"], "mean_flow": 1.0, "disagreement": [5.0, np.nan, 1.0]}
    named = ["", "side_branch_leak at b; autoregulation at all beds", "autoregulation at all beds"]
    pd.DataFrame(frame | {"named": named}).to_csv(tmp_path / "t.csv", index=False)
    drawn.tree(tmp_path / "t.csv", tmp_path / "t.png")
    assert is_png(tmp_path / "t.png")
    ((*_, words, lines), *_) = kept
    assert words == ["b", "side branch leak", "autoregulation", "c", "autoregulation", "a"]
    assert {((1.4, 0.0),), ((1.8, 0.0),), ((1.8, 1.0),)} <= lines
    pd.DataFrame(frame | {"named": ""}).to_csv(tmp_path / "t.csv", index=False)
    drawn.tree(tmp_path / "t.csv", tmp_path / "t.png")


def test_predicted_and_measured_means_are_drawn_in_clinical_units(tmp_path, kept):
    factors = {"flow": ML_PER_MIN, "pressure": MMHG, "perfusion": MBF_PER_MIN_PER_G, "ratio": 1.0}
    rows = [
        (name, fitted, measured * factor, 0.1 * factor, 3.0 * factor, (2.0 + measured) * factor)
        for name, factor in factors.items()
        for measured, fitted in ((1.0, True), (2.0, False))
    ]
    columns = ["quantity", "fitted", "measured", "sd", "recalibrated", "repaired"]
    frame = pd.DataFrame(rows, columns=columns).assign(
        condition="rest", location="a:b", statistic="mean", phase=np.nan, named=True
    )
    frame.to_csv(tmp_path / "r.csv", index=False)
    drawn.residuals(tmp_path / "r.csv", tmp_path / "r.png")
    assert [title for title, *_ in kept] == list(factors)
    units = [label.removeprefix("measured ± sd") for _, label, *_ in kept]
    assert units == [" (mL/min)", " (mmHg)", " (mL/min/g)", ""]
    for *_, lines in kept:
        rounded = {tuple((round(x, 9), round(y, 9)) for x, y in line) for line in lines}
        diagonal, before, after = (
            ((1.0, 1.0), (4.0, 4.0)),
            {((1.0, 3.0),), ((2.0, 3.0),)},
            {((1.0, 3.0),), ((2.0, 4.0),)},
        )
        assert {diagonal, *before, *after} <= rounded


def test_sizes_are_drawn_without_a_named_effect(tmp_path):
    columns = ["effect", "place", "parameter", "unit", "size", "posterior", "prior"]
    pd.DataFrame([], columns=columns).to_csv(tmp_path / "s.csv", index=False)
    drawn.sizes(tmp_path / "s.csv", tmp_path / "s.png")
    assert is_png(tmp_path / "s.png")


def test_branches_with_different_rankings_share_one_list_of_effects(tmp_path, monkeypatch):
    """Each bar is at its effect's name, because panels share their ticks."""
    bars = []
    original = drawn.saved

    @contextmanager
    def saved(output, **options):
        with original(output, **options) as (canvas, axes):
            yield canvas, axes
            canvas.canvas.draw()
            names = [label.get_text() for label in axes.flat[0].get_yticklabels()]
            for axis in axes.flat:
                bars.append({names[round(b.get_y() + b.get_height() / 2)]: b.get_width() for b in axis.patches})

    monkeypatch.setattr(drawn, "saved", saved)
    rows = [("lad", "diffuse_narrowing", 1.0, True), ("lad", "pressure_gain", 0.2, False)]
    rows += [("rca", "quadratic_stenosis", 0.9, True), ("rca", "diffuse_narrowing", 0.1, False)]
    columns = ["branch", "effect", "probability", "named"]
    pd.DataFrame(rows, columns=columns).to_csv(tmp_path / "e.csv", index=False)
    drawn.pairs_effects(tmp_path / "e.csv", tmp_path / "e.png")
    assert bars == [
        {"diffuse narrowing": 1.0, "pressure gain": 0.2, "quadratic stenosis": 0.0},
        {"diffuse narrowing": 0.1, "pressure gain": 0.0, "quadratic stenosis": 0.9},
    ]


def test_gap_and_ranking_are_drawn(tmp_path):
    models = ["recalibration alone", "with the named effects", "flexible discrepancy"]
    gap = {"model": models, "misfit": [3.0, 1.0, 2.0], "low": [2.5, 0.9, 1.5], "high": [3.5, 1.1, 2.5]}
    pd.DataFrame(gap).assign(log_predictive_density=0.0, expected_misfit=1.0).to_csv(tmp_path / "g.csv", index=False)
    drawn.gap(tmp_path / "g.csv", tmp_path / "g.png")
    names = {"round": 1, "effect": ["none", "leak"], "place": ["", "lad"], "probability": [0.1, 0.9], "score": 0.0}
    pd.DataFrame(names).assign(accepted=[False, True]).to_csv(tmp_path / "r.csv", index=False)
    drawn.ranking(tmp_path / "r.csv", tmp_path / "r.png")
    assert is_png(tmp_path / "g.png") and is_png(tmp_path / "r.png")


@pytest.fixture(scope="module")
def named(tmp_path_factory):
    """A case of a tree, by the parameters of the figures that name its vessels."""
    folder = tmp_path_factory.mktemp("named")
    case = write_case(folder / "given", small_tree(), ffr_beyond_mm="null")
    prepare_case(case, Settings(), folder / "case")
    return {"case": folder / "case/case.json", "tree": folder / "case/tree.vtp"}


def test_vessels_beds_and_places_have_the_names_of_the_case(tmp_path, kept, named):
    """In every figure of a search; names of the network are for programs."""
    place, effect, size = "branch1_seg0:J1", "quadratic_stenosis", np.linspace(0.0, 1.0, 5)
    wave = {"condition": "rest", "quantity": "flow", "location": place, "statistic": "waveform"}
    numbers = {"phase": size, "measured": 1.0, "sd": 0.1, "recalibrated": 1.0, "repaired": 1.0}
    pull = {"location": "branch1_seg0>lca1_seg0", "statistic": "mean", "distance_mm": 10 * size, "acting": ""}
    tables = {
        "tree": {"vessel": ["branch1_seg0", "lca2"], "parent": ["", "branch1_seg0"], "disagreement": 1.0, "named": ""},
        "residuals": wave | numbers | {"fitted": True, "named": True},
        "ranking": {"round": [1], "effect": effect, "place": place, "probability": 0.9, "accepted": True},
        "sizes": {"effect": effect, "place": place, "parameter": "loss", "size": size, "posterior": 1.0, "prior": 1.0},
        "pullback": wave | numbers | pull | {"vessel": ["branch1_seg0"] * 3 + ["lca2"] * 2, "named": True},
    }
    for name, columns in tables.items():
        pd.DataFrame(columns).to_csv(tmp_path / "t.csv", index=False)
        draw(f"discrepancy_{name}", {"table": str(tmp_path / "t.csv")} | named, tmp_path / f"{name}.svg")
        shown = "".join(re.findall(r"<!--(.*?)-->", (tmp_path / f"{name}.svg").read_text()))
        shown += " ".join(words for *_, texts, _ in kept for words in texts)  # with an outline, they are paths alone
        assert re.search(r"\bLM\b", shown), name
        assert not re.search(r"_seg|branch\d|:J\d", shown), name
