"""Options of `coronaryuq bench`: the command line's list of who takes which agrees with the benchmarks themselves."""

import importlib
import inspect

import pytest

from coronaryuq.cli.main import BENCHMARKS, OPTIONS, main
from coronaryuq.core.errors import InputError


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmark_takes_the_options_listed_for_it(name):
    taken = inspect.signature(importlib.import_module(f"coronaryuq.bench.{BENCHMARKS[name]}").run).parameters
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


@pytest.mark.parametrize(
    "words, line",
    [
        (
            ["discrepancy", "--quick", "--effects", "stenosis"],
            "error: bench discrepancy: --effects = 'stenosis': no cell of this benchmark; it has none, "
            "quadratic_stenosis, outside:bulging_territory\n",
        ),
        (
            ["discrepancy", "--solver", "3d", "--effects", "none"],
            "error: bench discrepancy: --effects = 'none': no cell of this benchmark; it has lca0_seg0:healthy, ",
        ),
        (
            ["discrepancy", "--solver", "3d", "--strengths", "weak"],
            "error: bench discrepancy: --strengths = ('weak',): not an option of --solver 3d\n",
        ),
        (
            ["discrepancy", "--solver", "3d", "--network", "loop.json"],
            "error: bench discrepancy: --network = 'loop.json': not an option of --solver 3d\n",
        ),
        (
            ["flow3d", "--data", "nowhere"],
            "error: nowhere: want at least two folders with mesh.json and batch*.jsonl\n",
        ),
        (
            ["coverage", "--rows", "table1.csv"],
            "error: bench coverage: --rows = 'table1.csv': is of published runs: --data wanted\n",
        ),
    ],
)
def test_an_option_that_would_do_nothing_is_one_line_at_once(words, line, capsys):
    assert main(["bench", *words]) == InputError.EXIT_CODE
    said = capsys.readouterr()
    assert said.out == "" and said.err.startswith(line) and said.err.count("\n") == 1


@pytest.mark.parametrize("name", ["table", "coverage"])
def test_published_runs_that_are_not_there_are_named_with_their_folder(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["bench", name, "--quick", "--data", "."]) == InputError.EXIT_CODE
    assert capsys.readouterr().err == f"error: {tmp_path}/params.csv: no such file\n"


@pytest.mark.parametrize("seeds", ["0", "-2", "many"])
def test_seeds_are_a_number_of_one_or_more(seeds, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["bench", "discrepancy", "--seeds", seeds])
    assert ended.value.code == 2
    assert f"argument --seeds: '{seeds}' is not an integer of 1 or more" in capsys.readouterr().err
