"""The report as its readers see it, in headless Chromium: at three widths, in the dark, in print, without scripts."""

import base64
import html
import io
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import read_csv
from support import browser

WIDTHS = {"desktop": (1280, 900), "tablet": (820, 1180), "phone": (390, 844)}
PRINTED = 717
"""Width of an A4 page within Chromium's margins, CSS pixels."""
LEAST_PT = 4.5
"""Size of the smallest printed letters."""
MOST_BYTES = 8e6
LONGER = """const text = document.createElement('p');
text.innerHTML = Array({lines}).fill('A line of text.').join('<br>');
document.querySelector('{place}').before(text);"""
"""Script that lengthens the page."""
CHECKS = Path(browser.__file__).with_name("page_checks.js").read_text()

pytestmark = pytest.mark.workflow
in_browser = pytest.mark.skipif(not browser.PROGRAM, reason="needs Chromium: apt-get install chromium")


@pytest.fixture(scope="module")
def page(results):
    return results / "report.html"


@pytest.fixture(scope="module")
def tab():
    with browser.tab() as opened:
        yield opened


def told(tab, check):
    """Return what a check of `page_checks.js` finds on the open page."""
    return tab.run(f"(() => {{ {CHECKS} return {check}(); }})()")


class Lines(HTMLParser):
    """Cells of the table of estimates by row, estimator and key: the value that it is sorted by, and its text."""

    def __init__(self, text):
        super().__init__()
        self.cells, self._line, self._key = {}, None, None
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        if tag == "tr":
            self._line = (given.get("data-row"), given.get("data-estimator"))
        elif tag == "td":
            self._key = given.get("data-key")
            if self._key and self._line:
                self.cells[(*self._line, self._key)] = [given["data-raw"], ""]

    def handle_data(self, data):
        if self._key and self._line and (*self._line, self._key) in self.cells:
            self.cells[(*self._line, self._key)][1] += data

    def handle_endtag(self, tag):
        self._key = None if tag == "td" else self._key


def test_the_numbers_of_the_page_are_those_of_the_tables(page, results):
    table = read_csv(results / "estimation" / "table.csv").set_index(["row", "estimator"])
    cells = Lines(page.read_text()).cells
    assert {key[:2] for key in cells} == set(table.index)
    for (row, estimator, key), (raw, text) in cells.items():
        if key not in ("mean", "std"):
            continue
        value = float(table.loc[(row, estimator), key])
        assert float(raw) == pytest.approx(value, rel=1e-9)
        if text != "–":
            scale = 100.0 if row.startswith("low_shear") else 1.0
            decimals = len(text.partition(".")[2])
            assert float(text) == pytest.approx(value * scale, abs=0.5001 * 10**-decimals), (row, estimator, key)


def plain(markup):
    """Return a text without its tags, with ordinary spaces."""
    return " ".join(html.unescape(re.sub(r"<[^>]*>", "", markup)).split())


def test_the_first_screen_has_the_patients_quantiles_and_probabilities(page, results):
    text = page.read_text()
    cards = dict(re.findall(r'<article class="card" aria-label="(\w+) stenosis">(.*?)</article>', text, re.S))
    conclusions = [plain(line) for line in re.findall(r"<li class=.*?</li>", text[: text.index("<article")], re.S)]
    rows = {row["row"]: row for row in read_json(results / "estimation" / "estimates.json")["rows"]}
    assert set(cards) == {"LAD", "LCx", "RCA"}
    for artery, markup in cards.items():
        of_artery = [rows[f"ffr_{pair}_{artery.lower()}"] for pair in ("ffr", "flow")]
        row = min(of_artery, key=lambda one: one["estimators"][one["recommended"]]["std"])
        low, median, high = (f"{row['beyond_the_mean']['predictive'][q]:.2f}" for q in ("0.05", "0.50", "0.95"))
        card = plain(markup)
        assert f"Median FFR {median} 90 % range {low} to {high}" in card
        (line,) = [line for line in conclusions if f"{artery} stenosis" in line]
        assert f"FFR is {median} (90 % range {low} to {high})" in line
        zones = row["beyond_the_mean"]["zones"]
        in_card = re.findall(r"<dd><b>(<|>|)\s*([\d.]+)\s%</b>", html.unescape(markup))
        in_line = re.search(r"or less is (below |above |)([\d.]+) %", line).groups()
        assert len(in_card) == len(zones)
        for (bound, shown), share in zip(
            [*in_card, in_line], [*(zone["value"] for zone in zones), 1 - zones[-1]["value"]], strict=True
        ):
            assert float(shown) == pytest.approx(100 * share, abs=1 if bound else 0.51), artery


def test_the_readings_along_the_tree_are_those_of_the_table(page, results):
    scene = json.loads(re.search(r'id="scene-data">(.*?)</script>', page.read_text(), re.S)[1])
    table = read_csv(results / "zerod" / "pressures.csv").set_index(["vessel", "position"])
    for pullback in scene["pullbacks"]:
        end = table.loc[(pullback["vessel"], 1.0)]
        assert pullback["points"][-1][1:4] == pytest.approx(end[["ffr_low", "ffr", "ffr_high"]].tolist(), abs=1e-4)
        assert pullback["points"][-1][5] == pytest.approx(60 * end["flow"], abs=0.06)
    assert (table["ffr_low"] <= table["ffr"]).all() and (table["ffr"] <= table["ffr_high"]).all()


def test_one_small_file_holds_everything(page):
    text = page.read_text()
    assert page.stat().st_size < MOST_BYTES
    assert not re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', text)
    heads = re.findall(r"<th\b[^>]*>", text)
    assert heads and all("scope=" in head for head in heads)
    assert all(len(alt) > 20 for alt in re.findall(r'<img alt="([^"]*)"', text))
    assert len(re.findall(r"^@(?:article|software)\{", text, re.M)) >= 4
    shown = re.sub(r"base64,[^\"]*|<(pre|script|style).*?</\1>", "", text, flags=re.S)
    assert not re.findall(r"\bBC_\w+|branch\d+|\b[lr]ca\d+|mean_flow", shown)


def test_a_space_that_does_not_break_stands_before_every_per_cent_sign(page):
    text = re.sub(r"base64,[^\"]*|<(pre|script|style).*?</\1>", "", page.read_text(), flags=re.S)
    said = [html.unescape(re.sub(r"<[^>]*>", "", text)), *re.findall(r'(?:alt|aria-label)="([^"]*)"', text)]
    assert sum(words.count("\u00a0%") for words in said) > 50
    assert not [found for words in said for found in re.findall(r".{0,40}\d ?%", words)]


def test_every_figure_has_a_number_and_an_anchor_in_the_order_of_the_page(page):
    text = page.read_text()
    anchors = re.findall(r'<figure id="(fig-[\w-]+)"', text)
    assert len(anchors) == text.count("<figure") > 10 and len(set(anchors)) == len(anchors)
    numbered = re.findall(r'<a class="anchor" href="#(fig-[\w-]+)">Figure (\d+)</a>', text)
    assert numbered == [(anchor, str(number)) for number, anchor in enumerate(anchors, 1)]


@in_browser
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", WIDTHS)
def test_no_script_fails_and_nothing_is_wider_than_the_window(page, tab, width, dark):
    tab.errors.clear(), tab.requests.clear()
    tab.open(page, *WIDTHS[width], dark=dark)
    assert tab.errors == [] and tab.requests == [page.resolve().as_uri()]
    assert tab.run("document.documentElement.scrollWidth") <= WIDTHS[width][0]


@in_browser
@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_overlaps_is_cut_off_or_empty(page, tab, width):
    tab.open(page, *WIDTHS[width])
    assert tab.run("document.querySelectorAll('.card').length") == 3
    assert told(tab, "overlaps") == []
    assert told(tab, "clipped") == []
    assert told(tab, "empty") == []


@in_browser
def test_figures_scroll_on_a_telephone_at_a_size_whose_labels_can_be_read(page, tab):
    tab.open(page, *WIDTHS["phone"])
    shown = tab.run(
        "[...document.querySelectorAll('.picture img')].map(i => i.clientWidth / Math.min(i.naturalWidth, 700))"
    )
    assert len(shown) > 5 and min(shown) > 0.99


@in_browser
@pytest.mark.parametrize("dark", [False, True])
def test_every_text_can_be_read_on_its_ground(page, tab, dark):
    tab.open(page, *WIDTHS["desktop"], dark=dark)
    tab.run("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert told(tab, "contrast") == []


def picture(tab):
    """Return the drawn tree, (height, width, 3), 0 to 1."""
    import matplotlib.image

    drawn = tab.run("document.querySelector('canvas.view').toDataURL('image/png')")
    return matplotlib.image.imread(io.BytesIO(base64.b64decode(drawn.partition(",")[2])))[..., :3]


def pointer(tab, kind, x, y, **more):
    tab.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)


@in_browser
def test_the_tree_is_drawn_and_turned_by_the_mouse_and_read_by_pointing(page, tab):
    tab.open(page, 1280, 1600)
    tab.run("document.querySelector('canvas.view').scrollIntoView({block: 'center'})")
    before = picture(tab)
    assert len(np.unique((before * 15).astype(int).reshape(-1, 3), axis=0)) > 60
    left, top, width, height = tab.run(
        "(() => { const b = document.querySelector('canvas.view').getBoundingClientRect();"
        " return [b.left, b.top, b.width, b.height]; })()"
    )
    told = set()
    for x in np.linspace(left + 0.2 * width, left + 0.8 * width, 25):
        for y in np.linspace(top + 0.2 * height, top + 0.8 * height, 12):
            pointer(tab, "mouseMoved", x, y)
            told.add(tab.run("(t => t.hidden ? '' : t.textContent)(document.querySelector('.tip'))"))
    named = {text.partition(":")[0] for text in told if text}
    assert {"LAD", "RCA"} <= named and all(re.search(r"FFR 0\.\d\d \(|FFR 1\.00 \(", text) for text in told if text)
    middle = (left + width / 2, top + height / 2)
    pointer(tab, "mousePressed", *middle, button="left", clickCount=1)
    pointer(tab, "mouseMoved", middle[0] + 150, middle[1] + 40, button="left", buttons=1)
    pointer(tab, "mouseReleased", middle[0] + 150, middle[1] + 40, button="left", clickCount=1)
    turned = picture(tab)
    assert np.abs(turned - before).mean() > 0.01
    tab.run("[...document.querySelectorAll('.tools button')].find(b => b.textContent === 'Front').click()")
    assert np.abs(picture(tab) - before).mean() < 0.002
    tab.run("[...document.querySelectorAll('.tools button')].find(b => b.textContent === 'Show territories').click()")
    assert np.abs(picture(tab) - before).mean() > 0.01


@in_browser
def test_a_finger_turns_the_tree(page, tab):
    tab.open(page, *WIDTHS["phone"])
    tab.run("document.querySelector('canvas.view').scrollIntoView({block: 'center'})")
    before = picture(tab)
    x, y = tab.run(
        "(b => [b.left + b.width / 2, b.top + b.height / 2])"
        "(document.querySelector('canvas.view').getBoundingClientRect())"
    )
    tab.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
    for k in range(1, 6):
        tab.call("Input.dispatchTouchEvent", type="touchMove", touchPoints=[{"x": x + 15 * k, "y": y}])
    tab.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    assert np.abs(picture(tab) - before).mean() > 0.01


@in_browser
def test_the_table_is_filtered_and_sorted(page, tab, results):
    lines = len(read_csv(results / "estimation" / "table.csv"))
    tab.open(page, *WIDTHS["desktop"])
    shown = "[...document.querySelectorAll('#estimates-table tbody tr')].filter(r => !r.hidden)"
    rows = tab.run(f"{shown}.length")
    assert 0 < rows < lines
    tab.run("document.querySelector('.filters input[type=checkbox]').click()")
    assert tab.run(f"{shown}.length") == lines
    tab.run("(i => { i.value = 'lad ffr'; i.oninput(); })(document.querySelector('.filters input[type=search]'))")
    assert 0 < tab.run(f"{shown}.length") < lines / 2
    for order in (1, -1):
        tab.run("document.querySelectorAll('#estimates-table thead .sort')[4].click()")
        means = tab.run(f"{shown}.map(r => parseFloat(r.querySelector('[data-key=mean]').dataset.raw))")
        assert means == sorted(means, reverse=order < 0)


@in_browser
def test_a_wire_is_read_along_every_artery(page, tab):
    tab.open(page, *WIDTHS["desktop"])
    names = tab.run("[...document.querySelectorAll('.pullback option')].map(o => o.textContent)")
    assert "D1" in names and "LCx" in names
    labels = tab.run(
        "(s => [...Array(s.options.length).keys()].map(k => { s.value = k; s.onchange();"
        " return document.querySelector('.pullback svg')?.getAttribute('aria-label'); }))"
        "(document.querySelector('.pullback select'))"
    )
    assert all(
        re.fullmatch(r"FFR from the ostium to the end of .*: [01]\.\d\d at the end, .*", label) for label in labels
    )


@in_browser
def test_without_scripts_nothing_is_hidden(page, tab):
    tab.open(page, *WIDTHS["desktop"], script=False)
    tab.call("Emulation.setScriptExecutionDisabled", value=False)
    assert tab.run("document.querySelector('noscript') !== null")
    rows = tab.run("[...document.querySelectorAll('#estimates-table tbody tr')].map(r => r.hidden)")
    assert rows and not any(rows)
    assert tab.run("document.querySelector('#fig-tree_ffr img').naturalWidth") > 300


@in_browser
def test_print_loses_no_column_and_no_card(page, tab, tmp_path):
    tab.open(page, PRINTED, 1040)
    tab.call("Emulation.setEmulatedMedia", media="print")
    assert told(tab, "wide") == [] and told(tab, "overlaps") == [] and told(tab, "clipped") == []
    assert tab.run("getComputedStyle(document.querySelector('nav')).display") == "none"
    tab.call("Emulation.setEmulatedMedia", media="")
    tab.pdf(tmp_path / "page.pdf")
    assert (tmp_path / "page.pdf").read_bytes().count(b"/Type /Page\n") < 40


CHANGES = {
    "as it is": "",
    "longer first": LONGER.format(lines=22, place="main"),
    "longer text": LONGER.format(lines=13, place="#matched"),
    "other text": LONGER.format(lines=31, place="#noise"),
    "six lesions": "document.querySelectorAll('.card').forEach(card => card.after(card.cloneNode(true)))",
    "no section of the engineer": "document.querySelector('#engineer').remove()",
}
"""Scripts that give the page other lengths."""


@in_browser
@pytest.mark.skipif(not shutil.which("pdftoppm"), reason="needs pdftoppm: apt-get install poppler-utils")
@pytest.mark.parametrize("change", CHANGES)
def test_no_printed_page_but_the_last_lacks_three_tenths(page, tab, tmp_path, change):
    """What is not broken, such as a figure with its caption, goes to the next page: its height is limited."""
    tab.open(page, PRINTED, 1040)
    tab.run(f"(() => {{ {CHANGES[change]}; return 0; }})()")
    tab.pdf(tmp_path / "page.pdf")
    subprocess.run(["pdftoppm", "-r", "30", "-gray", "page.pdf", "page"], cwd=tmp_path, check=True)
    empty = []
    for path in sorted(tmp_path.glob("page-*.pgm")):
        inked = np.flatnonzero((np.asarray(Image.open(path)) < 200).any(axis=1))
        empty.append(1.0 - inked[-1] / Image.open(path).height)
    assert max(empty[:-1]) < 0.3
    if not CHANGES[change]:
        assert empty[0] < 0.12, "the tree is not below the cards"


@in_browser
def test_the_text_of_a_figure_is_printed_at_a_size_that_can_be_read(page, tab, results):
    """The size of letters follows from the drawing: glyphs are outlines at a hundredth of the size in points."""
    tab.open(page, PRINTED, 1040)
    tab.call("Emulation.setEmulatedMedia", media="print")
    shown = tab.run(
        "[...document.querySelectorAll('figure img')].map(i => [i.closest('figure').id, i.clientWidth, i.clientHeight])"
    )
    tab.call("Emulation.setEmulatedMedia", media="")
    assert len(shown) > 10
    for name, width, height in shown:
        drawing = (results / "figures" / f"{name.removeprefix('fig-')}.svg").read_text()
        wide, high = (float(re.search(rf'{side}="([\d.]+)pt"', drawing)[1]) for side in ("width", "height"))
        smallest = 100 * min(map(float, re.findall(r"scale\((0\.\d+) -", drawing)))
        assert min(width / wide, height / high) * 0.75 * smallest > LEAST_PT, name
