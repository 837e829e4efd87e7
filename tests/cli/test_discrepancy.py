"""The command checks its options before any work, and never overwrites its input."""

import html
from pathlib import Path

import pytest

from coronaryuq.cli import discrepancy as command
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_text
from coronaryuq.discrepancy.result import write
from coronaryuq.discrepancy.selection.shared_device import NONE
from coronaryuq.report.captions import SEARCHES
from support.discrepancy_command import arguments, case_arguments, case_words


def test_results_do_not_overwrite_the_case(stenosis_case):
    folder = stenosis_case[0]
    with pytest.raises(InputError, match=r"would overwrite .*measurements.csv; choose another folder"):
        command.main(case_arguments(folder, folder))


def test_results_do_not_overwrite_drives_or_tables_of_pairs(tmp_path):
    write_text(tmp_path / "c.yaml", "rest: {drive: {AORTA: drives/mine.csv}}\n")
    words = ["--model", "m.json", "--measurements", "m.csv", "--conditions", tmp_path / "c.yaml", "--out", tmp_path]
    with pytest.raises(InputError, match=r"would overwrite .*mine.csv; choose another folder"):
        command.main(arguments(*words))
    with pytest.raises(InputError, match=r"would overwrite .*pairs.csv; choose another folder"):
        command.main(arguments("--pairs", tmp_path / "pairs.csv", "x.csv", "--out", tmp_path))


def test_an_empty_folder_name_is_rejected():
    with pytest.raises(InputError, match="--out = '': empty; name a folder"):
        command.main(arguments("--model", "x.json", "--out", ""))


def test_missing_options_are_reported(tmp_path):
    with pytest.raises(InputError, match="--measurements"):
        command.main(arguments("--model", "x.json", "--out", tmp_path))


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (
            ("--pairs", "a", "b", "--recordings", "f", "DOG"),
            "--recordings = ['f', 'DOG']: cannot be combined with --pairs",
        ),
        (("--pairs", "a", "b", "--model", "m.json"), "--model = 'm.json': cannot be combined with --pairs"),
        (("--recordings", "f", "DOG", "--model", "m.json"), "--model = 'm.json': cannot be combined with --recordings"),
        (("--recordings", "f", "DOG", "--conditions", "c"), "--conditions = 'c': cannot be combined with --recordings"),
    ],
)
def test_only_one_kind_of_input_is_accepted(tmp_path, words, text):
    with pytest.raises(InputError) as caught:
        command.main(arguments(*words, "--out", tmp_path / "out"))
    assert str(caught.value) == f"command line: {text}; remove one"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "text"), [(("f",), "at least one animal"), (("f", "A", "B", "A"), "= 'A': is named twice")]
)
def test_recordings_need_animals_each_named_once(tmp_path, words, text):
    with pytest.raises(InputError, match=text):
        command.main(arguments("--recordings", *words, "--out", tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_the_noise_of_pairs_cannot_be_set(tmp_path):
    with pytest.raises(InputError, match="--noise = 'stated': only applies to waveforms; --pairs has none"):
        command.main(arguments("--pairs", "a", "b", "--noise", "stated", "--out", tmp_path / "out"))


def test_a_page_shows_the_answer_with_its_figures(stenosis_case, tmp_path, capsys):
    """Figures without content are left out, and the next answer removes them all: they are not its own."""
    out = tmp_path / "out"
    assert command.main(arguments(*case_words(stenosis_case[0], out), "--page")) == 0
    printed, progress = capsys.readouterr()
    page, made = (out / "report.html").read_text(), {path.stem for path in (out / "figures").iterdir()}
    assert html.unescape(page).count(printed.strip()) == 1 and f"wrote {out / 'report.html'}" in progress
    assert made == {"tree", "residuals", "ranking", "sizes", "gap"}
    assert all(f'data-file="{name}.png"' in page for name in made) and "Campaign" not in page
    write.clear(out)
    assert not (out / "report.html").exists() and not list((out / "figures").iterdir())


def test_several_recordings_are_on_one_page():
    several, device = arguments("--recordings", "folder", "A", "B", "--out", "out"), {"quantity": "flow"}
    device |= {"places": {"A": "x", "B": "y"}, "probabilities": {NONE: 0.95}, "errors": []}
    found, note = command._of_page(several, Path("out"), {"devices": [device]})
    assert found == {"A": Path("out/A"), "B": Path("out/B")} and note.startswith(
        "One device reads flow in A and B: no "
    )
    one = arguments("--recordings", "folder", "A", "--out", "out")
    assert command._of_page(one, Path("out"), {"paragraph": "a text"}) == ({"A": Path("out")}, "")


def test_all_figures_of_a_page_are_removed_with_an_earlier_answer():
    assert set(write.FIGURES) == set(SEARCHES)
