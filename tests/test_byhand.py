"""Stages run by hand end in one line and an exit code when their input is wrong."""

import pytest

from coronaryuq.core import by_hand
from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.settings import Settings


def test_sound_settings_reach_the_work_and_end_in_0(capsys):
    seen = []
    assert by_hand.run(seen.append, Settings, '{"steps_per_cycle": 600}') == 0
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
def test_wrong_settings_are_one_line(settings, line, capsys):
    assert by_hand.run(lambda given: pytest.fail("ran"), Settings, settings) == InputError.EXIT_CODE
    said = capsys.readouterr().err
    assert said.startswith(line) and said.count("\n") == 1


def test_wrong_input_of_the_work_is_one_line(capsys):
    def work(settings):
        raise InputError("pilot.csv", "sample", None, "missing")

    assert by_hand.run(work, Settings, "{}") == InputError.EXIT_CODE
    assert capsys.readouterr().err == "error: pilot.csv: sample: missing\n"
