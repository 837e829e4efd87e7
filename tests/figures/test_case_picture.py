"""The picture of `coronaryuq check` shows every end by name, stenoses, and what has no row."""

from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from coronaryuq.cli.check import check, draw_check
from coronaryuq.core.errors import InputError
from coronaryuq.figures import case_picture as drawn
from coronaryuq.figures.label_places import Discs, place_labels
from support.case_files import small_tree, write_case


@pytest.fixture
def shown(monkeypatch):
    """Texts and legend of the pictures that are drawn."""
    texts: list[str] = []
    original = drawn.saved

    @contextmanager
    def saved(output, **subplots):
        with original(output, **subplots) as (figure, axes):
            yield figure, axes
            texts.extend(text.get_text() for text in axes.texts)
            (legend,) = figure.legends
            texts.extend([*(text.get_text() for text in legend.get_texts()), legend.get_title().get_text()])

    monkeypatch.setattr(drawn, "saved", saved)
    return texts


def test_ends_stenoses_territories_and_scale_are_drawn(tmp_path, shown):
    found = check(write_case(tmp_path, small_tree()))
    assert draw_check(found, None) == [f"picture: {tmp_path / 'case.check.png'}"]
    assert {"lca1", "lca2", "rca1", "aorta_outlet", "2 cm", "LAD", "LCx", "RCA", "aorta", "stenosis"} <= set(shown)
    assert any(text.startswith("LAD stenosis, ") for text in shown)
    assert "read in cm; territories: nearest outlet" in shown
    assert (tmp_path / "case.check.png").read_bytes()[:4] == b"\x89PNG"


def test_places_of_a_wire_are_drawn_with_what_was_measured(tmp_path, shown):
    entries = "[{name: distal, artery: LAD, distance: 5, measured: 0.843}, {artery: RCA, distance: 3}]"
    found = check(write_case(tmp_path, small_tree(), ffr_at=entries))
    draw_check(found, None)
    assert {"FFR at distal, measured 0.84", "FFR at rca1 3.0 cm", "pressure wire"} <= set(shown)


def test_an_end_without_a_row_is_asked_for_in_words_and_picture(tmp_path, shown):
    path = write_case(tmp_path, small_tree())
    table = tmp_path / "outlets.csv"
    table.write_text(table.read_text().replace("lca2,lca2,LV,LCx\n", ""))
    found = check(path)
    assert found.error is not None and "lca2" in str(found.error)
    assert "ends without a row, what are they? lca2 (no row in the outlets table, 2.0 mm)" in found.lines
    draw_check(found, str(tmp_path / "mine.svg"))
    assert "lca2?" in shown and "no row: what is it?" in shown
    assert (tmp_path / "mine.svg").is_file() and not (tmp_path / "case.check.png").exists()


def test_the_picture_is_there_although_flows_are_missing(tmp_path, shown):
    path = write_case(tmp_path, small_tree(), perfusion=None, territory_flows="{file: flows.csv, unit: mL/min}")
    (tmp_path / "flows.csv").write_text("name,flow\nlca1,\nlca2,3\nrca1,3\n")
    found = check(path)
    assert found.error is not None and found.error.field == "flow"
    assert draw_check(found, None) and "rca1" in shown
    assert (
        "unit: coronary ends of 2 to 2.4 mm in diameter: is the unit cm? (if mm, 0.2 to 0.24 mm; if m, 200 to 240 mm)"
        in found.lines
    )


def test_a_picture_of_another_format_is_refused(tmp_path):
    found = check(write_case(tmp_path, small_tree()))
    with pytest.raises(InputError, match="--picture = 'tree.doc': name a file that ends in .png or .svg"):
        draw_check(found, "tree.doc")


def test_the_same_case_gives_the_same_bytes(tmp_path):
    found = check(write_case(tmp_path, small_tree()))
    for name in ("a.png", "b.png"):
        draw_check(found, str(tmp_path / name))
    assert Path(tmp_path / "a.png").read_bytes() == Path(tmp_path / "b.png").read_bytes()


def test_the_place_where_ffr_is_read_is_drawn(tmp_path, shown):
    draw_check(check(write_case(tmp_path, small_tree())), None)
    assert "FFR is read" in shown
    assert any(text.startswith("LAD stenosis, ") and text.endswith("\nFFR 15 mm beyond it") for text in shown)
    shown.clear()
    draw_check(check(write_case(tmp_path, small_tree(), ffr_beyond_mm="null")), None)
    assert "FFR is read" not in shown and not any("beyond" in text for text in shown)


def touches(box, discs: Discs) -> bool:
    gaps = np.maximum(np.abs(discs.centres - box.centre) - box.half, 0.0)
    return bool((np.linalg.norm(gaps, axis=1) < discs.radii).any())


def test_labels_cover_neither_one_another_nor_markers_nor_lines():
    """Markers that have no label, and the width of lines, were not counted."""
    line = np.stack([np.linspace(0, 10, 101), np.zeros(101)], axis=1)
    points = np.array([[2.0, 0.0], [2.2, 0.0], [5.0, 0.0], [9.9, 0.0]])
    lines = Discs(line, np.full(len(line), 0.2))
    markers = Discs(np.array([[x, y] for x in (1.0, 3.0, 5.5, 8.0, 9.0) for y in (-0.7, 0.0, 0.7)]), np.full(15, 0.2))
    boxes = place_labels(points, [(2.0, 0.3)] * 4, lines, markers, 10.0)
    for k, box in enumerate(boxes):
        assert not touches(box, lines) and not touches(box, markers)
        assert not any((np.abs(box.centre - other.centre) < box.half + other.half).all() for other in boxes[:k])
        assert np.linalg.norm(box.anchor - points[k]) < 2.0


@pytest.mark.parametrize("seed", range(4))
def test_no_label_of_a_picture_lies_on_a_marker_or_another_label(tmp_path, monkeypatch, seed):
    """By what is drawn, in the pictures of cases with several stenoses and places of a wire."""
    inked: list[Bbox] = []
    marked: list[Bbox] = []
    original = drawn.saved

    @contextmanager
    def saved(output, **subplots):
        with original(output, **subplots) as (figure, axes):
            yield figure, axes
            figure.canvas.draw()
            # A text without its arrow, and without the scale bar's, which has none.
            inked.extend(Text.get_window_extent(text) for text in axes.texts if text.arrow_patch is not None)
            for line in axes.lines:
                if line.get_marker() not in ("None", None) and len(line.get_xdata()):
                    at = axes.transData.transform(line.get_xydata())[0]
                    half = line.get_markersize() / 2 * figure.dpi / 72
                    marked.append(Bbox([at - half, at + half]))

    monkeypatch.setattr(drawn, "saved", saved)
    random = np.random.default_rng(seed)
    starts = np.sort(random.uniform(1.4, 4.4, 2)) + (0.0, 0.6)
    stenoses = [f"{{name: R{k}, vessel: rca1, start: {at:.2f}, end: {at + 0.4:.2f}}}" for k, at in enumerate(starts)]
    wires = [f"{{artery: {one}, distance: {random.uniform(2.5, 5):.2f}}}" for one in ("LAD", "LAD", "LCx", "RCA")]
    path = write_case(tmp_path, small_tree(), stenoses=f"[{', '.join(stenoses)}]", ffr_at=f"[{', '.join(wires)}]")
    found = check(path)
    assert found.error is None and draw_check(found, None)
    assert len(inked) == 10 and len(marked) >= 10
    for k, box in enumerate(inked):
        assert not any(box.overlaps(other) for other in inked[:k])
        assert not any(box.overlaps(marker) for marker in marked)


def test_a_registered_map_has_a_second_picture(tmp_path):
    sitk = pytest.importorskip("SimpleITK")
    found = check(write_case(tmp_path, small_tree()))
    scan = sitk.GetImageFromArray(np.random.default_rng(0).normal(size=(20, 22, 24)).astype(np.float32))
    scan.SetOrigin([-12.0, -11.0, -14.0])
    sitk.WriteImage(scan, str(tmp_path / "ct.nrrd"))
    found.sketch.scan = (tmp_path / "ct.nrrd", 1.0)
    drawn = [tmp_path / name for name in ("case.check.png", "case.check.registration.png")]
    assert draw_check(found, None) == [f"picture: {path}" for path in drawn]
    assert all(path.read_bytes()[:4] == b"\x89PNG" for path in drawn)
