"""Arguments of the wrong kind and wrong settings end in one line and an exit code."""

import pytest

from coronaryuq.cli import main
from coronaryuq.core.command_line import run_with_settings
from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.settings import Settings


def test_valid_settings_reach_the_work(capsys):
    seen = []
    assert run_with_settings(seen.append, Settings, '{"steps_per_cycle": 600}') == 0
    assert seen[0].steps_per_cycle == 600 and capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "settings, line",
    [
        (
            '{"steps_per_cycle": 3}',
            "error: --settings: steps_per_cycle = 3: input should be greater than or equal to 100",
        ),
        ('{"steps": 600}', "error: --settings: steps = 600: extra inputs are not permitted"),
        ("{", "error: --settings = '{': invalid JSON"),
    ],
)
def test_wrong_settings_are_reported_on_one_line(settings, line, capsys):
    assert run_with_settings(lambda given: pytest.fail("ran"), Settings, settings) == InputError.EXIT_CODE
    message = capsys.readouterr().err
    assert message.startswith(line) and message.count("\n") == 1


def test_wrong_input_found_by_the_work_is_reported_on_one_line(capsys):
    def work(settings):
        raise InputError("pilot.csv", "sample", None, "missing")

    assert run_with_settings(work, Settings, "{}") == InputError.EXIT_CODE
    assert capsys.readouterr().err == "error: pilot.csv: sample: missing\n"


COMMANDS = {
    "tune": ["tune", "loop.json", "targets.csv", "--out", "out"],
    "discrepancy": ["discrepancy", "--pairs", "a.csv", "b.csv", "--out", "out"],
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("option", "value", "least"),
    [("--threads", "0", 1), ("--threads", "-2", 1), ("--seed", "-1", 0), ("--seed", "1.5", 0)],
)
def test_threads_must_be_positive_and_seeds_not_negative(command, option, value, least, capsys):
    with pytest.raises(SystemExit) as ended:
        main.main([*COMMANDS[command], option, value])
    assert ended.value.code == 2
    assert f"argument {option}: '{value}' is not an integer of {least} or more\n" in capsys.readouterr().err


@pytest.mark.parametrize("command", COMMANDS)
def test_zero_is_a_valid_seed(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main.main([*COMMANDS[command], "--seed", "0"]) == 2
    assert "no such file" in capsys.readouterr().err
