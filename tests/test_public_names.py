"""What `import coronaryuq` gives: fast, by name, and nothing else."""

import subprocess
import sys

import pandas as pd
import pytest

import coronaryuq
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.svzerodsolver.tables import simulate
from support.pair_tables import noisy_pairs
from support.zerod_networks import bifurcation

HEAVY = ("numpy", "pandas", "pydantic", "numba", "torch", "scipy", "yaml")


def test_importing_the_package_imports_nothing_heavy():
    code = f"import sys, coronaryuq; print([name for name in {HEAVY} if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "[]\n"


def test_the_public_names_are_there_and_others_are_not():
    assert {"open", "discover", "zerod"} <= set(dir(coronaryuq))
    for name in ("open", "discover"):
        assert callable(getattr(coronaryuq, name)) and getattr(coronaryuq, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'close'"):
        _ = coronaryuq.close
    with pytest.raises(AttributeError, match="no attribute 'solver_of'"):
        _ = coronaryuq.zerod.solver_of


def test_solve_takes_the_path_or_the_content_of_a_network(tmp_path):
    import json

    network = bifurcation()
    (tmp_path / "network.json").write_text(json.dumps(network))
    expected = simulate(network)
    for given in (network, tmp_path / "network.json", str(tmp_path / "network.json")):
        pd.testing.assert_frame_equal(coronaryuq.zerod.solve(given), expected, check_exact=True)
    with pytest.raises(InputError, match="nowhere.json: no such file"):
        coronaryuq.zerod.solve("nowhere.json")


@pytest.mark.slow
def test_discover_gives_what_the_command_writes(tmp_path):
    from coronaryuq.cli.main import main
    from coronaryuq.core.io.atomic import read_json

    simulated, measured = noisy_pairs(tmp_path, 1, quadratic=0.3)
    answer = coronaryuq.discover(pairs=(simulated, measured), out=tmp_path / "mine", seed=1)
    assert main(["discrepancy", "--pairs", str(simulated), str(measured), "--out", str(tmp_path / "theirs")]) == 0
    assert (tmp_path / "mine" / "pairs.csv").read_bytes() == (tmp_path / "theirs" / "pairs.csv").read_bytes()
    assert read_json(tmp_path / "theirs" / "discrepancy.json")["paragraph"] == answer["paragraph"]
    assert coronaryuq.discover(pairs=(simulated, measured), seed=1)["paragraph"] == answer["paragraph"]


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"model": "m.json"}, "discover: measurements: missing; or give pairs"),
        ({"model": "m.json", "pairs": ("a", "b")}, "discover: pairs: cannot be combined with model"),
    ],
)
def test_wrong_arguments_of_discover_are_one_line(given, line):
    with pytest.raises(InputError) as caught:
        coronaryuq.discover(**given)
    assert str(caught.value).startswith(line)


def test_results_of_another_version_are_opened_all_the_same(tmp_path):
    (tmp_path / "campaign.yaml").write_text("name: old\nsetting_of_yesterday: 1\n")
    draws = tmp_path / "posterior" / "draws.csv"
    draws.parent.mkdir()
    draws.write_text("chain,generation,BC_a,log_density\n0,1,1.5,2.0\n")
    opened = coronaryuq.open(tmp_path)
    assert opened.draws["BC_a"].tolist() == [1.5] and opened.draws.attrs["units"]["BC_a"] == "1"
    with pytest.raises(InputError, match="setting_of_yesterday = 1: unknown setting"):
        _ = opened.configuration
    assert "unknown setting" in opened._repr_html_()
