"""Both backends of the 0D solver give the same results."""

import importlib.util
import shutil

import numpy as np
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.svzerodsolver import choose, program
from support.zerod_networks import bifurcation, built_heart, closed_loop


@pytest.fixture(params=["svzerod", "svzerodsolver"])
def make_svzerod(request, monkeypatch):
    """svZeroDSolver as a backend, by its Python module and by its command, each where it is installed."""
    module = importlib.util.find_spec("svzerod") is not None
    if not (module if request.param == "svzerod" else shutil.which("svzerodsolver")):
        pytest.skip(f"needs {request.param}, which is not installed")
    monkeypatch.setattr(program, "installed", lambda: request.param)
    return lambda network: choose.make("svzerod", network)


def test_both_backends_give_the_same_numbers(make_svzerod):
    network = closed_loop(steps=200, cycles=3, stenosis=0.0)
    changes, names = {"BC_left.Ra": np.array([1e4, 2e4])}, ["mean_flow:left:BC_left", "max_pressure:CLH:J_heart_outlet"]
    ours, other = (make(network).run_cycles(changes, names, cycles=3) for make in (Engine, make_svzerod))
    assert list(other.status) == ["ok", "ok"]
    for name in names:
        # Where a valve shuts, rounding may move svZeroDSolver's own result by this much.
        assert np.allclose(ours.values[name], other.values[name], rtol=1e-3)


def test_both_backends_give_the_same_waveforms_where_no_valve_shuts(make_svzerod):
    network, changes = bifurcation(), {"left.stenosis_coefficient": np.array([0.0, 3.0]), "RCR_right.Rd": 9e3}
    names = Engine(network).unknowns
    ours, other = (make(network).run_cycles(changes, waveforms=names, cycles=3) for make in (Engine, make_svzerod))
    assert list(other.status) == ["ok", "ok"]
    for name in names:
        difference = np.abs(ours.waveforms[name] - other.waveforms[name]).max()
        assert difference <= 1e-8 * np.abs(other.waveforms[name]).max(), name


def test_both_backends_continue_from_a_state(make_svzerod):
    network, name = bifurcation(), "flow:left:RCR_left"
    start = Engine(network).run_cycles(cycles=2).state
    ours, other = (make(network).run_cycles(waveforms=[name], cycles=1, start=start) for make in (Engine, make_svzerod))
    assert np.allclose(ours.waveforms[name], other.waveforms[name], rtol=1e-8)


def test_both_backends_solve_a_heart_of_chambers_and_valves(make_svzerod):
    network, changes = built_heart(), {"LV.Emax": np.array([2.0, 3.0]), "LV.tau_1": 0.18, "AV.Rmin": 0.01}
    names = Engine(network).unknowns
    ours, other = (make(network).run_cycles(changes, waveforms=names, cycles=2) for make in (Engine, make_svzerod))
    assert list(other.status) == ["ok", "ok"]
    for name in names:
        difference = np.abs(ours.waveforms[name] - other.waveforms[name]).max()
        assert difference <= 1e-8 * np.abs(other.waveforms[name]).max(), name


@pytest.mark.parametrize(
    ("modules", "command", "said"),
    [(("svzerod", "pysvzerod"), True, "svzerod"), (("pysvzerod",), True, "pysvzerod"), ((), True, "svzerodsolver")]
    + [((), False, None)],
)
def test_the_module_is_preferred_to_the_program(monkeypatch, modules, command, said):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object() if name in modules else None)
    monkeypatch.setattr(shutil, "which", lambda name: "/bin/svzerodsolver" if command else None)
    assert program.installed() == said
    if said is None:
        with pytest.raises(InputError, match="pip install svzerod"):
            choose.make("svzerod", bifurcation())
