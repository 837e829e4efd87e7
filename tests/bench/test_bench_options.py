"""Options of `coronaryuq bench`: the command line's list of who takes which agrees with the benchmarks themselves."""

import importlib
import inspect

import pytest

from coronaryuq.cli import BENCHMARKS, OPTIONS, main
from coronaryuq.errors import InputError


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmark_takes_the_options_listed_for_it(name):
    taken = inspect.signature(importlib.import_module(f"coronaryuq.bench.{name}").run).parameters
    assert not any(one.kind is one.VAR_KEYWORD for one in taken.values())
    assert {option for option, owners in OPTIONS.items() if name in owners} <= taken.keys()
    assert not {option for option, owners in OPTIONS.items() if name not in owners} & taken.keys()


@pytest.mark.parametrize(
    "words, line",
    [
        (
            ["zerod", "--seeds", "1"],
            "error: bench zerod: --seeds = 1: not an option of it, but of discrepancy\n",
        ),
        (
            ["zerod", "--strengths", "weak", "strong"],
            "error: bench zerod: --strengths = ['weak', 'strong']: not an option of it, but of discrepancy\n",
        ),
        (
            ["dream", "--data", "runs"],
            "error: bench dream: --data = 'runs': not an option of it, but of flow3d, table and coverage\n",
        ),
        (
            ["campaign", "--network", "loop.json"],
            "error: bench campaign: --network = 'loop.json': not an option of it, but of zerod and discrepancy\n",
        ),
        (
            ["perfusion", "--offset", "0"],
            "error: bench perfusion: --offset = 0: not an option of it, but of discrepancy\n",
        ),
    ],
)
def test_another_benchmark_s_option_is_one_line(words, line, capsys):
    assert main(["bench", *words]) == InputError.EXIT_CODE
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", line)
