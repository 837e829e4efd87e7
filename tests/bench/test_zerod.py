"""Benchmark of the 0D engine: its fixed keys, with and without the shared data."""

import json

import pytest

from coronaryuq.bench import zerod
from coronaryuq.bench.coronary_tree import synthetic_loop
from coronaryuq.case.network.topology import closed_loop_tree
from coronaryuq.cli.main import main
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.svzerodsolver import program

KEYS = {
    *("network", "vessels", "unknowns", "samples", "steps_per_cycle", "cycles", "cpu_s_per_sample", "newton_per_step"),
    *("cpu_s_per_sample_periodic", "cycles_periodic", "cycle_error", "compile_s", "peak_rss_mb"),
    *("svzerod_cpu_s_per_sample", "ratio_vs_svzerod", "max_rel_diff_svzerod"),
}


def test_the_synthetic_loop_has_the_size_of_the_real_one_and_physiological_pressure():
    network = synthetic_loop()
    graph = closed_loop_tree(network, "synthetic loop")
    assert len(network["vessels"]) == 50
    assert sum("Coronary" in kind for kind in map(graph.kind, graph.blocks)) == 22
    lossy = [v for v in network["vessels"] if v["zero_d_element_values"]["stenosis_coefficient"] > 0]
    assert sum(v.get("entrance", 0.0) < 1.0 for v in lossy) == 3
    pressure = "mean_pressure:J_heart_outlet:aorta"
    result = Engine(network).run_cycles(quantities=[pressure], cycles=12, steps_per_cycle=200)
    assert result.ok[0] and 40 < result.values[pressure][0] / 1333.22 < 180


@pytest.mark.slow
@pytest.mark.parametrize("shared_data", [True, False])
def test_the_benchmark_has_the_fixed_keys(monkeypatch, tmp_path, request, shared_data):
    if shared_data:
        request.getfixturevalue("shared")
    else:
        monkeypatch.setattr(zerod, "_SHARED", tmp_path)
    result = zerod.run(quick=True, samples=17, steps=400, cycles=1)
    assert result.keys() >= KEYS
    assert result["network"].startswith("closed-loop-22" if shared_data else "synthetic")
    assert result["failed"] == result["failed_periodic"] == 0
    assert result["samples"] == 17 and result["vessels"] == (49 if shared_data else 50)
    assert 1.0 < result["newton_per_step"] < 30.0 and result["cycle_error"] < 1e-4


def test_the_command_prints_one_json_object_without_the_shared_data(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(zerod, "_SHARED", tmp_path)
    monkeypatch.setattr(program, "installed", lambda: None)
    assert main(["bench", "zerod", "--quick", "--json"]) == 0
    (line,) = capsys.readouterr().out.strip().splitlines()
    result = json.loads(line)
    assert result["benchmark"] == "zerod" and result["quick"] is True and result["svzerod_cpu_s_per_sample"] is None
    assert result["network"].startswith("synthetic") and result["failed"] == 0
