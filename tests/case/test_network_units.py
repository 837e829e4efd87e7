"""A network in mmHg and its conversion to CGS are the same circulation."""

import copy

import numpy as np
import pytest

from coronaryuq.case.network.build import Bed, Physics, network_from_tree
from coronaryuq.case.network.units import PER_PRESSURE, PRESSURE_PER, detect_pressure_unit, rescaled, to_cgs
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MMHG
from coronaryuq.zerod.network.parameters import (
    ACTIVATIONS,
    BOUNDARIES,
    CHAMBERS,
    CLOSED_LOOP,
    COUPLINGS,
    JUNCTIONS,
    VALVES,
    VESSELS,
)
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine
from support.zerod_networks import built_heart

NEITHER = {
    "Tsa", "tpwave", "iml", "imr", "Vrv_u", "Vlv_u", "Kxv_ra", "Kxv_la", "Vaso_ra", "Vaso_la", "closed_loop_outlet",
    "t", "Q", "T_vc", "T_vr", "upstream_block", "downstream_block", "Vrest", "Vrd", "Vrs", "Vaso", "Kxv", "t_active",
    "t_twitch", "contract_start", "relax_start", "contract_duration", "relax_duration", "t_shift", "tau_1", "tau_2",
    "m1", "m2",
}  # fmt: skip
"""Times, volumes, flows and shares: the same in mmHg and in dyn/cm2."""


@pytest.fixture
def loop(small_tree):
    beds = [Bed("BC_lca1", "lca1", False), Bed("BC_lca2", "lca2", False), Bed("BC_rca1", "rca1", True)]
    # Linear, so that both units take the same steps: at a nonlinear one a valve may open a step apart.
    return network_from_tree(small_tree, beds, {"BC_RCR1": "aorta_outlet"}, (), Physics(kinetic_factor=0.0))


def in_mmhg(network):
    """The conversion of a closed loop, written by hand."""
    network = copy.deepcopy(network)
    for vessel in network["vessels"]:
        values = vessel["zero_d_element_values"]
        for name, value in values.items():
            values[name] = value * MMHG if name == "C" else value / MMHG
    for bc in network["boundary_conditions"]:
        for name, value in bc["bc_values"].items():
            if not isinstance(value, bool):
                bc["bc_values"][name] = value * MMHG if name.startswith("C") else value / MMHG
    heart = network["closed_loop_blocks"][0]["parameters"]
    for name, value in heart.items():
        if name in ("Cp", "Cpa"):
            heart[name] = value * MMHG
        elif name[0] in "REL" or name.startswith("Kxp"):
            heart[name] = value / MMHG
    for name in network["initial_condition"]:
        if name.startswith(("pressure", "P_")):
            network["initial_condition"][name] /= MMHG
    return network


def assert_same(one, other):
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_same(one[key], other[key])
    elif isinstance(one, list):
        for a, b in zip(one, other, strict=True):
            assert_same(a, b)
    elif isinstance(one, float):
        assert one == pytest.approx(other, rel=1e-12)
    else:
        assert one == other


def test_the_unit_is_found_and_the_conversion_undone(loop):
    converted, system = to_cgs(in_mmhg(loop), "auto")
    assert system == "mmHg" and detect_pressure_unit(loop, "network") == "cgs"
    assert_same(converted, loop)


def test_a_converted_network_has_the_periodic_state_of_the_original(loop):
    quantities = ["mean_pressure:J_heart_outlet:aorta", "mean_flow:J_heart_outlet:aorta", "max_V_LV:CLH"]
    given = Engine(in_mmhg(loop)).run_cycles(quantities=quantities, cycles=4, steps_per_cycle=500).values
    cgs = (
        Engine(to_cgs(in_mmhg(loop), "mmHg")[0]).run_cycles(quantities=quantities, cycles=4, steps_per_cycle=500).values
    )
    for name, factor in zip(quantities, (MMHG, 1.0, 1.0), strict=True):
        assert cgs[name] == pytest.approx(given[name] * factor, rel=1e-9)


@pytest.mark.parametrize(
    "case",
    [
        *("pulsatileFlow_R_RCR", "pulsatileFlow_R_coronary", "pulsatileFlow_R_coronary_varres"),
        *("pulsatileFlow_CStenosis_steadyPressure", "steadyFlow_blood_vessel_junction", "steadyFlow_bifurcationR_R1"),
    ],
)
def test_open_loops_convert_too(shared, case):
    """Any unit of pressure gives the same flows, and pressures that differ by the factor."""
    network = read_network(shared / f"data/svzerod-cases/{case}.json")
    names = [name for name in Engine(network).unknowns if name.startswith(("flow", "pressure"))]
    found = Engine(rescaled(network, 8.0)).run_cycles(waveforms=names, cycles=2).waveforms
    for name, wave in Engine(network).run_cycles(waveforms=names, cycles=2).waveforms.items():
        factor = 8.0 if name.startswith("pressure") else 1.0
        assert np.abs(found[name] - factor * wave).max() <= 1e-7 * factor * np.abs(wave).max(), name


@pytest.mark.parametrize("smooth", [False, True])
def test_a_heart_of_chambers_and_valves_converts_too(smooth):
    network = built_heart(smooth=smooth)
    names = [name for name in Engine(network).unknowns if name.startswith(("flow", "Vc"))]
    found = Engine(rescaled(network, 8.0)).run_cycles(waveforms=names).waveforms
    for name, wave in Engine(network).run_cycles(waveforms=names).waveforms.items():
        assert np.abs(found[name] - wave).max() <= 1e-6 * np.abs(wave).max(), name


def test_a_resistance_of_no_circulation_is_refused(loop):
    for bc in loop["boundary_conditions"]:
        if bc["bc_type"] == "ClosedLoopRCR":
            bc["bc_values"]["Rd"] = 1e6
    with pytest.raises(InputError, match="set .units"):
        detect_pressure_unit(loop, "network.json")


def test_every_parameter_of_every_element_has_its_place():
    """Resistances, inductances, elastances, compliances: all; times, volumes and shares: none."""
    known = {**VESSELS, **JUNCTIONS, **COUPLINGS, **BOUNDARIES, **CLOSED_LOOP, **VALVES, **CHAMBERS, **ACTIVATIONS}
    assert set(PRESSURE_PER) == set(known)
    for kind, parameters in known.items():
        placed = [*PRESSURE_PER[kind], *PER_PRESSURE.get(kind, ())]
        assert sorted([*placed, *(NEITHER & set(parameters))]) == sorted(parameters), kind


def test_the_published_mmhg_case_is_recognised(shared):
    network = read_network(shared / "data/svzerod-cases/closedLoopHeart_withCoronaries.json")
    assert to_cgs(network, "auto")[1] == "mmHg"
    published = read_network(shared / "data/closed-loop-22/svzerod_tuning_cgs.json")
    assert to_cgs(published, "auto")[1] == "cgs"
    assert np.isclose(1.28 * MMHG, 1.0 / sum(
        1.0 / (b["bc_values"]["Rp"] + b["bc_values"]["Rd"])
        for b in published["boundary_conditions"] if b["bc_type"] == "ClosedLoopRCR"), rtol=0.01)  # fmt: skip
