"""Numbers on the command line: what a command cannot take ends at once, on one line of argparse's."""

import pytest

from coronaryuq.cli import main

COMMANDS = {
    "tune": ["tune", "loop.json", "targets.csv", "--out", "out"],
    "discrepancy": ["discrepancy", "--pairs", "a.csv", "b.csv", "--out", "out"],
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("option", "value", "least"),
    [("--threads", "0", 1), ("--threads", "-2", 1), ("--seed", "-1", 0), ("--seed", "1.5", 0)],
)
def test_threads_are_one_or_more_and_seeds_nought_or_more(command, option, value, least, capsys):
    with pytest.raises(SystemExit) as ended:
        main.main([*COMMANDS[command], option, value])
    assert ended.value.code == 2
    assert f"argument {option}: '{value}' is no number of {least} or more\n" in capsys.readouterr().err


@pytest.mark.parametrize("command", COMMANDS)
def test_nought_is_a_seed(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main.main([*COMMANDS[command], "--seed", "0"]) == 2
    assert "no such file" in capsys.readouterr().err
