"""Options of `coronaryuq bench`: every benchmark adds its own, and those that would have no effect are errors."""

import argparse
import importlib
import inspect

import pytest

from coronaryuq.cli.main import BENCHMARKS, main
from coronaryuq.core.errors import InputError


@pytest.mark.parametrize("module_name", [module for module, _ in BENCHMARKS.values()])
def test_a_benchmark_takes_the_options_that_it_adds(module_name):
    module = importlib.import_module(f"coronaryuq.bench.{module_name}")
    parser = argparse.ArgumentParser()
    getattr(module, "add_arguments", lambda parser: None)(parser)
    taken = inspect.signature(module.run).parameters
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in taken.values()):
        taken = inspect.signature(module.Options).parameters
    assert vars(parser.parse_args([])).keys() | {"quick"} <= taken.keys()


@pytest.mark.parametrize(
    "words",
    [["zerod", "--seeds", "1"], ["dream", "--data", "runs"], ["campaign", "--network", "loop.json"]],
)
def test_the_option_of_another_benchmark_is_refused(words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["bench", *words])
    assert ended.value.code == 2
    assert f"unrecognized arguments: {' '.join(words[1:])}" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["bench", "solve", "tune", "fit", "discrepancy"])
def test_help_is_complete_for_every_command(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    printed = capsys.readouterr().out
    assert ended.value.code == 0
    assert all(name in printed for name in BENCHMARKS) if command == "bench" else "--" in printed


@pytest.mark.parametrize(
    "words, line",
    [
        (
            ["discrepancy", "--quick", "--effects", "stenosis"],
            "error: bench discrepancy: --effects = 'stenosis': no cell of this benchmark; known: none, "
            "quadratic_stenosis, outside:bulging_territory\n",
        ),
        (
            ["discrepancy", "--solver", "3d", "--effects", "none"],
            "error: bench discrepancy: --effects = 'none': no cell of this benchmark; known: lca0_seg0:healthy, ",
        ),
        (
            ["discrepancy", "--solver", "3d", "--strengths", "weak"],
            "error: bench discrepancy: --strengths = ['weak']: not an option of --solver 3d\n",
        ),
        (
            ["discrepancy", "--solver", "3d", "--network", "loop.json"],
            "error: bench discrepancy: --network = 'loop.json': not an option of --solver 3d\n",
        ),
        (
            ["flow3d", "--data", "nowhere"],
            "error: nowhere: expected two or three folders with mesh.json and batch*.jsonl\n",
        ),
        (
            ["coverage", "--rows", "table1.csv"],
            "error: bench coverage: --rows = 'table1.csv': needs --data, the folder of published runs\n",
        ),
    ],
)
def test_an_option_without_effect_is_reported_on_one_line_at_once(words, line, capsys):
    assert main(["bench", *words]) == InputError.EXIT_CODE
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.startswith(line) and printed.err.count("\n") == 1


@pytest.mark.parametrize("name", ["table", "coverage"])
def test_missing_published_runs_are_named_with_their_folder(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["bench", name, "--quick", "--data", "."]) == InputError.EXIT_CODE
    assert capsys.readouterr().err == f"error: {tmp_path}/params.csv: no such file\n"


@pytest.mark.parametrize("seeds", ["0", "-2", "many"])
def test_the_number_of_seeds_must_be_positive(seeds, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["bench", "discrepancy", "--seeds", seeds])
    assert ended.value.code == 2
    assert f"argument --seeds: '{seeds}' is not an integer of 1 or more" in capsys.readouterr().err
