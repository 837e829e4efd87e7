"""A network in mmHg and its conversion to CGS are the same circulation."""

import numpy as np
import pytest

from coronaryuq.calibration.network_units import PER_PRESSURE, PRESSURE_PER, detect, to_cgs
from coronaryuq.errors import InputError
from coronaryuq.units import MMHG
from coronaryuq.zerod.engine import Engine
from coronaryuq.zerod.network import read_network
from coronaryuq.zerod.parameters import BOUNDARIES, CLOSED_LOOP, VESSELS


def test_the_unit_is_found_and_the_conversion_undone(small_loop, in_mmhg):
    converted, system = to_cgs(in_mmhg(small_loop), "auto")
    assert system == "mmHg" and detect(small_loop, "network") == "cgs"
    for part in ("vessels", "boundary_conditions", "closed_loop_blocks", "initial_condition"):
        assert_same(converted[part], small_loop[part])


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


def test_a_converted_network_beats_as_the_given_one(small_loop, in_mmhg):
    quantities = ["mean_pressure:J_heart_outlet:aorta", "mean_flow:J_heart_outlet:aorta", "max_V_LV:CLH"]
    given = Engine(in_mmhg(small_loop)).run(quantities=quantities, cycles=4, steps_per_cycle=500).values
    cgs = (
        Engine(to_cgs(in_mmhg(small_loop), "mmHg")[0]).run(quantities=quantities, cycles=4, steps_per_cycle=500).values
    )
    factors = (MMHG, 1.0, 1.0)
    for name, factor in zip(quantities, factors, strict=True):
        assert cgs[name] == pytest.approx(given[name] * factor, rel=1e-4)


def test_a_resistance_of_no_circulation_is_refused(small_loop):
    for bc in small_loop["boundary_conditions"]:
        if bc["bc_type"] == "ClosedLoopRCR":
            bc["bc_values"]["Rd"] = 1e6
    with pytest.raises(InputError, match="say units"):
        detect(small_loop, "network.json")


def test_every_parameter_of_the_convertible_elements_has_its_place():
    """Resistances, inductances, elastances, compliances: all; times, volumes and shares: none."""
    neither = {
        "Tsa",
        "tpwave",
        "iml",
        "imr",
        "Vrv_u",
        "Vlv_u",
        "Kxv_ra",
        "Kxv_la",
        "Vaso_ra",
        "Vaso_la",
        "closed_loop_outlet",
    }
    known = {**VESSELS, **BOUNDARIES, **CLOSED_LOOP}
    for kind in PRESSURE_PER:
        assert set(PRESSURE_PER[kind]) | set(PER_PRESSURE[kind]) | neither >= set(known[kind]), kind


def test_the_published_mmhg_case_is_recognised(shared):
    network = read_network(shared / "data/svzerod-cases/closedLoopHeart_withCoronaries.json")
    assert to_cgs(network, "auto")[1] == "mmHg"
    published = read_network(shared / "data/closed-loop-22/svzerod_tuning_cgs.json")
    assert to_cgs(published, "auto")[1] == "cgs"
    assert np.isclose(1.28 * MMHG, 1.0 / sum(
        1.0 / (b["bc_values"]["Rp"] + b["bc_values"]["Rd"])
        for b in published["boundary_conditions"] if b["bc_type"] == "ClosedLoopRCR"), rtol=0.01)  # fmt: skip
