"""Make the pictures of the report in docs/pictures: every screen at three widths, in the dark, and in print.

    python tools/report_pictures.py results/laptop/report.html docs/pictures

Needs Chromium and pdftoppm (apt-get install chromium poppler-utils).
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support import browser

WIDTHS = {"desktop": (1280, 900), "tablet": (820, 1180), "phone": (390, 844)}
SHEETS = {"desktop": (3600, 0.18), "tablet": (3600, 0.2), "phone": (3600, 0.25)}
"""Height of a strip of the page, CSS pixels, and the scale at which strips stand side by side."""
SHOT = 3000
"""Height of one screenshot at most, pixels; Chromium has a limit."""
PAGES_IN_A_ROW, DPI = 6, 32
COLOURS = 256


def main(page: Path, folder: Path) -> None:
    """Write all pictures."""
    with browser.tab() as tab:
        for name, (width, height) in WIDTHS.items():
            tab.open(page, width, height)
            tab.run("document.querySelector('nav').style.position = 'static'")
            strip, scale = SHEETS[name]
            save(sheet(whole(tab, width), strip, scale), folder / f"report-{name}.png")
        tab.open(page, *WIDTHS["desktop"])
        end = tab.run("document.querySelector('#fig-tree').getBoundingClientRect().top + scrollY")
        save(part(tab, (0, 0, 1280, end)), folder / "report-summary.png")
        tab.run("document.querySelector('#estimates').scrollIntoView()")
        save(part(tab, box(tab, "#estimates", 900)), folder / "report-estimates.png")
        tab.open(page, *WIDTHS["desktop"], dark=True)
        tab.run("[...document.querySelectorAll('.tools button')].find(b => /territories/.test(b.textContent)).click()")
        save(part(tab, box(tab, "#fig-tree")), folder / "report-tree-dark.png")
        tab.open(page, 717, 1040)
        save(printed(tab), folder / "report-print.png")


def box(tab: browser.Tab, selector: str, height: float | None = None) -> tuple[float, float, float, float]:
    """Return left, top, width and height of an element on the page, the height as given if it is."""
    place = f"document.querySelector('{selector}').getBoundingClientRect()"
    left, top, width, own = tab.run(f"(b => [b.left, b.top + scrollY, b.width, b.height])({place})")
    return left, top, width, height or own


def part(tab: browser.Tab, clip: tuple[float, float, float, float]) -> Image.Image:
    """Return a part of the page."""
    with tempfile.TemporaryDirectory() as folder:
        tab.screenshot(Path(folder) / "part.png", clip)
        return Image.open(Path(folder) / "part.png").convert("RGB")


def whole(tab: browser.Tab, width: int) -> Image.Image:
    """Return the whole page, put together from screenshots."""
    height = int(tab.run("document.documentElement.scrollHeight"))
    picture = Image.new("RGB", (width, height), "white")
    for top in range(0, height, SHOT):
        picture.paste(part(tab, (0, top, width, min(SHOT, height - top))), (0, top))
    return picture


def sheet(picture: Image.Image, strip: int, scale: float, gap: int = 12) -> Image.Image:
    """Return a long page cut into strips that stand side by side."""
    tops = range(0, picture.height, strip)
    width, height = round(picture.width * scale), round(strip * scale)
    made = Image.new("RGB", (len(tops) * (width + gap) - gap, height), "#8a949e")
    for place, top in enumerate(tops):
        cut = picture.crop((0, top, picture.width, min(top + strip, picture.height)))
        made.paste(cut.resize((width, round(cut.height * scale)), Image.Resampling.LANCZOS), (place * (width + gap), 0))
    return made


def printed(tab: browser.Tab, gap: int = 8) -> Image.Image:
    """Return all printed pages in rows."""
    with tempfile.TemporaryDirectory() as folder:
        tab.pdf(Path(folder) / "page.pdf")
        subprocess.run(["pdftoppm", "-r", str(DPI), "-png", "page.pdf", "page"], cwd=folder, check=True)
        pages = [Image.open(path).convert("RGB") for path in sorted(Path(folder).glob("page-*.png"))]
    width, height = pages[0].width + gap, pages[0].height + gap
    rows = -(-len(pages) // PAGES_IN_A_ROW)
    made = Image.new("RGB", (PAGES_IN_A_ROW * width - gap, rows * height - gap), "#8a949e")
    for number, page in enumerate(pages):
        made.paste(page, (number % PAGES_IN_A_ROW * width, number // PAGES_IN_A_ROW * height))
    return made


def save(picture: Image.Image, path: Path) -> None:
    """Save a picture with a palette of its own, so that it is small."""
    picture.quantize(COLOURS, kmeans=2, dither=Image.Dither.NONE).save(path, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
