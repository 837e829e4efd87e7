"""svZeroDSolver's public cases and output options, run live by its Python module and by the solver here."""

import itertools
import json

import numpy as np
import pytest

from coronaryuq.bench.conformance import FOLDER_VARIABLE, TOLERANCE, case_files, case_folder, compare, difference
from coronaryuq.zerod.svzerodsolver import program, tables
from support.zerod_networks import bifurcation, built_heart

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(program.installed() not in program.MODULES, reason="needs svZeroDSolver: pip install svzerod"),
]

FOLDER = case_folder()
CASES = [path.relative_to(FOLDER).as_posix() for path in case_files(FOLDER)]
ABSENT = pytest.param("", marks=pytest.mark.skip(f"needs cases in {FOLDER_VARIABLE} or ../shared/data/svzerod-cases"))


@pytest.mark.parametrize("case", CASES or [ABSENT])
def test_what_svzerodsolver_solves_is_solved_alike(case):
    """To 1e-6 of the largest value of each unknown, or as closely as it agrees with itself where rounding decides."""
    found = compare(FOLDER / case, FOLDER)
    if found.refused:
        assert found.refused_here and "\n" not in found.refused_here
    else:
        assert found.agrees, found


@pytest.mark.parametrize("variable_based", [False, True])
@pytest.mark.parametrize("make", [bifurcation, built_heart])
def test_every_combination_of_output_options_gives_the_same_table(make, variable_based):
    network = make(steps=40)
    network["simulation_parameters"] |= {"number_of_cardiac_cycles": 3, "output_variable_based": variable_based}
    options = ("output_all_cycles", "output_mean_only", "output_derivative")
    for chosen, interval in itertools.product(itertools.product((False, True), repeat=3), (1, 3, 7)):
        network["simulation_parameters"] |= dict(zip(options, chosen, strict=True)) | {"output_interval": interval}
        theirs, ours = program.simulate(network), tables.simulate(network)
        apart, where = difference(ours, theirs)
        assert apart < TOLERANCE, (chosen, interval, where)


@pytest.mark.parametrize("smooth", [False, True])
def test_hearts_of_chambers_and_valves_agree_with_any_damping_and_from_a_steady_start(smooth):
    for rho, steady in itertools.product((0.0, 0.5, 1.0), (False, True)):
        network = built_heart(smooth=smooth)
        network["simulation_parameters"] |= {"rho_infty": rho, "steady_initial": steady, "output_variable_based": True}
        apart, where = difference(tables.simulate(network), program.simulate(network))
        assert apart < TOLERANCE, (rho, steady, where)


def test_keys_that_it_ignores_are_ignored():
    network = bifurcation()
    plain = tables.simulate(network)
    network |= {"y": {}, "dy": {}, "calibration_parameters": {"maximum_iterations": 20}}
    network["vessels"][0] |= {"vessel_D": 0.3, "generation": 2, "viscosity": 0.04, "density": 1.06}
    assert difference(tables.simulate(network), plain) == (0.0, "")
    assert difference(program.simulate(network), plain)[0] < 1e-9


def test_what_it_says_does_not_mix_with_results(capfd):
    network = bifurcation()
    network["simulation_parameters"] |= {"use_cycle_to_cycle_error": True}
    program.simulate(network)
    print(json.dumps({"result": 1}))
    said = capfd.readouterr()
    assert json.loads(said.out) == {"result": 1} and "Percent error" in said.err


def test_its_reason_is_given_where_it_fails():
    network = bifurcation()
    network["vessels"][0]["zero_d_element_type"] = "Pump"
    with pytest.raises(RuntimeError, match="Pump"):
        program.simulate(network)
    assert np.isfinite(program.simulate(bifurcation())["flow_in"]).all()
