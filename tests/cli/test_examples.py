"""The examples in the help of every command are valid commands, and misspelt words are understood."""

import re
import shlex

import pytest

from coronaryuq.cli.examples import EXAMPLES
from coronaryuq.cli.main import BENCHMARKS, COMMANDS, _parser, _split, main

COMMAND_LINES = [command for shown in EXAMPLES.values() for command, _ in shown]


def test_every_command_has_examples():
    with_examples = set(EXAMPLES)
    assert set(COMMANDS) | {f"bench {name}" for name in BENCHMARKS} <= with_examples
    assert {"", "check", "explain", "verify", "doctor", "bench", "serve"} <= with_examples


@pytest.mark.parametrize("command", COMMAND_LINES)
def test_an_example_is_a_valid_command(command):
    words = shlex.split(command.rpartition("&& ")[2])
    assert words[0] == "coronaryuq"
    if "--help" not in words:
        words, _ = _split(words[1:])
        options = _parser(words).parse_args(words)
        assert callable(options.run)


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_help_shows_the_examples(name, capsys):
    with pytest.raises(SystemExit) as ended:
        main([*name.split(), "--help"])
    printed = capsys.readouterr().out
    assert ended.value.code == 0
    assert all(command in printed and remark in printed for command, remark in EXAMPLES[name])


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["chek", "case.yaml"], "did you mean check?"),
        (["bench", "zeord"], "did you mean zerod?"),
        (["verify", "results/x", "--remov-all"], "did you mean --remove?"),
        (["fit", "a.json", "b.csv", "--hyperemea", "0.24"], "did you mean --hyperaemia?"),
    ],
)
def test_a_misspelt_word_is_answered_with_what_was_meant(words, meant, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith(meant)


def test_a_word_that_resembles_nothing_gets_no_suggestion(capsys):
    with pytest.raises(SystemExit):
        main(["xylophone"])
    assert not re.search("did you mean", capsys.readouterr().err)
