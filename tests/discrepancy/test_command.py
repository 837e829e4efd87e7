"""The command checks its options before any work, and never overwrites its input."""

import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_text
from coronaryuq.discrepancy import command
from support.discrepancy_command import arguments, case_arguments


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
