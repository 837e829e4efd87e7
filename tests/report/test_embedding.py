"""Figures of the page are numbered in its order, other figures between them counted."""

from coronaryuq.report.embedding import figures_of_sections


def test_numbers_run_through_the_page(tmp_path):
    paths = [tmp_path / f"{name}.svg" for name in ("tree_ffr", "flows", "chains", "scatter", "budget")]
    for path in paths:
        path.write_text("<svg/>")
    sections = figures_of_sections([str(path) for path in paths], {}, others={"fit": 3})
    numbers = {item["name"]: item["number"] for items in sections.values() for item in items}
    assert numbers == {"tree_ffr": 2, "flows": 3, "chains": 7, "scatter": 8, "budget": 9}
