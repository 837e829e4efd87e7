"""Static pressure at probes: Bernoulli's equation between the ends of a network, in each of its units."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core import units
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Series
from coronaryuq.zerod.effects.dynamic_pressure import AT_DRIVE, AT_PROBES, DynamicPressure
from coronaryuq.zerod.effects.library import SEARCHED
from support.zerod_networks import network

WIDE, NARROW, LENGTH = 2.0, 0.5, 3.0
"""Areas, cm2, and length, cm, of two vessels in series."""
FLOW = 30.0 + 20.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 50, endpoint=False))[None, :]
PRESSURE = np.full_like(FLOW, 1e5)
SIZE = {"share": np.ones(1)}


def anatomy(drive: str = "PRESSURE", unit: float = 1.0, inertance: float = 1.0) -> Anatomy:
    """Two vessels in series without losses; `unit`: dyn/cm2 per unit of pressure."""
    vessels = [
        {
            "vessel_id": number,
            "vessel_name": name,
            "vessel_length": LENGTH,
            "boundary_conditions": ends,
            "zero_d_element_type": "BloodVessel",
            "zero_d_element_values": {
                "R_poiseuille": 8.0 * np.pi * units.BLOOD_VISCOSITY * LENGTH / area**2 / unit,
                "L": inertance * units.BLOOD_DENSITY * LENGTH / area / unit,
                "C": 0.0,
                "stenosis_coefficient": 0.0,
            },
        }
        for number, (name, area, ends) in enumerate(
            [("wide", WIDE, {"inlet": "IN"}), ("narrow", NARROW, {"outlet": "OUT"})]
        )
    ]
    joined = {"junction_name": "J0", "junction_type": "NORMAL_JUNCTION", "inlet_vessels": [0], "outlet_vessels": [1]}
    ends = [
        {"bc_name": "IN", "bc_type": drive, "bc_values": {"t": [0.0, 1.0], drive[0].replace("F", "Q"): [1.0, 1.0]}},
        {"bc_name": "OUT", "bc_type": "RESISTANCE", "bc_values": {"R": 100.0, "Pd": 0.0}},
    ]
    return Anatomy(network(vessels, ends, junctions=[joined]))


def read(where: Anatomy, location: str, place: str, quantity: str = "pressure", unit: float = 1.0) -> np.ndarray:
    """The pressure as a probe at a location reads it, dyn/cm2."""
    effect = DynamicPressure(units.BLOOD_DENSITY / unit)
    series = Series("rest", quantity, location, "waveform", np.arange(50) / 50.0, 1.0)
    other = None if effect.elsewhere(place, series, where) is None else FLOW
    return effect.read(place, SIZE, series, PRESSURE / unit, other, where) * unit


def head(area: float) -> np.ndarray:
    return units.BLOOD_DENSITY * (FLOW / area) ** 2 / 2.0


@pytest.mark.parametrize("unit", [1.0, units.MMHG])
def test_static_pressure_falls_with_the_square_of_the_velocity(unit):
    where = anatomy(unit=unit)
    assert read(where, "narrow:OUT", AT_PROBES, unit=unit) == pytest.approx(PRESSURE - head(NARROW), rel=1e-12)
    assert read(where, "wide:J0", AT_PROBES, unit=unit) == pytest.approx(PRESSURE - head(WIDE), rel=1e-12)


def test_between_two_static_pressures_lies_the_change_of_the_head():
    """As Bernoulli's equation says: the pressure that drives the network is one that a transducer read."""
    where, place = anatomy(), "J0:narrow"
    change = sum(read(where, place, at) - PRESSURE for at in (AT_PROBES, AT_DRIVE))
    assert change == pytest.approx(head(WIDE) - head(NARROW), rel=1e-12)


def test_what_drives_the_network_is_read_as_it_is():
    where = anatomy()
    assert DynamicPressure().places(where) == [AT_PROBES, AT_DRIVE]
    assert all(np.array_equal(read(where, "IN:wide", at), PRESSURE) for at in (AT_PROBES, AT_DRIVE))
    flow = anatomy("FLOW")
    assert DynamicPressure().places(flow) == [AT_PROBES]
    assert read(flow, "IN:wide", AT_PROBES) == pytest.approx(PRESSURE - head(WIDE), rel=1e-12)


def test_flows_and_inner_pressures_of_beds_are_read_as_they_are():
    where = anatomy()
    assert np.array_equal(read(where, "narrow:OUT", AT_PROBES, "flow"), PRESSURE)
    assert np.array_equal(read(where, "P_c:OUT", AT_PROBES), PRESSURE)


def test_an_inertance_that_is_too_large_for_the_resistance_does_not_narrow_the_vessel():
    where = anatomy(inertance=10.0)
    assert read(where, "narrow:OUT", AT_PROBES) == pytest.approx(PRESSURE - head(NARROW), rel=1e-12)


def test_it_is_an_error_of_any_model_and_no_effect_to_name():
    assert not any(isinstance(one, DynamicPressure) for one in SEARCHED)
    one, series = DynamicPressure(), Series("rest", "pressure", "narrow:OUT", "mean", None, 1.0)
    bare = anatomy()
    for vessel in bare.vessels.values():
        vessel["zero_d_element_values"] |= {"L": 0.0, "R_poiseuille": 0.0}
    assert one.read(AT_PROBES, SIZE, replace(series), PRESSURE, FLOW, bare) is PRESSURE, "areas are not known"
