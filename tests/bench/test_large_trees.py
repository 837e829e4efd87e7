"""Benchmark of trees with many outlets: agreement with svZeroDSolver, and what it reports."""

import numpy as np
import pytest

from coronaryuq.bench.large_trees import open_tree, run
from coronaryuq.zerod.network.read import check_network
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.svzerodsolver import program


@pytest.mark.long
@pytest.mark.skipif(program.installed() is None, reason="needs svZeroDSolver")
def test_a_tree_of_200_outlets_agrees_with_svzerodsolver():
    network = open_tree(200)
    check_network(network, "tree")
    engine = Engine(network)
    names = [name for name in engine.unknowns if name.endswith("BC_4") or name.endswith("branch0_seg0")]
    here = engine.run_cycles(waveforms=names)
    there = program.SvZeroD(network).run_cycles(waveforms=names)
    for name in names:
        ours, theirs = here.waveforms[name][0], there.waveforms[name][0]
        assert np.abs(ours - theirs).max() < 1e-9 * np.abs(theirs).max()


@pytest.mark.long
def test_set_up_and_memory_grow_with_the_outlets():
    small, large = run(outlets=[50, 500])["trees"]
    assert (small["unknowns"], large["unknowns"]) == (446, 4496)
    assert large["peak_rss_mb"] - large["rss_before_mb"] < 30 * max(5.0, small["peak_rss_mb"] - small["rss_before_mb"])
    assert small["us_per_step_and_sample"] > 0
