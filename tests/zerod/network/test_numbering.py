"""Unknowns are numbered and named as in svZeroDSolver; periods and connections must be consistent."""

import numpy as np
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.numbering import Model
from support.zerod_networks import bifurcation, built_heart, closed_loop


def test_unknowns_are_named_and_ordered_as_svzerodsolver_does():
    assert Model(bifurcation()).variables[:6] == [
        *("flow:INFLOW:trunk", "pressure:INFLOW:trunk", "flow:left:RCR_left", "pressure:left:RCR_left"),
        *("flow:right:RCR_right", "pressure:right:RCR_right"),
    ]
    assert Model(closed_loop()).variables[-12:] == [
        *("V_RA:CLH", "Q_RA:CLH", "P_RV:CLH", "V_RV:CLH", "Q_RV:CLH", "P_pul:CLH"),
        *("P_LA:CLH", "V_LA:CLH", "Q_LA:CLH", "P_LV:CLH", "V_LV:CLH", "Q_LV:CLH"),
    ]


def test_periods_that_differ_by_rounding_are_accepted():
    network = bifurcation()
    period = Model(network).period
    network["simulation_parameters"]["cardiac_period"] = float(np.nextafter(period, 2.0))
    assert Model(network).period == pytest.approx(period, rel=1e-12)


def test_periods_that_disagree_are_reported():
    network = bifurcation()
    network["simulation_parameters"]["cardiac_period"] = 1.2
    with pytest.raises(InputError, match="inconsistent cardiac period; INFLOW"):
        Model(network)


def test_a_vessel_without_an_outlet_is_reported():
    network = bifurcation()
    network["junctions"][0]["outlet_vessels"] = [1]
    with pytest.raises(InputError, match="right"):
        Model(network)


def test_a_chamber_without_a_valve_is_named():
    loop = built_heart()
    del loop["valves"][0]
    with pytest.raises(InputError, match="chambers.LA: has 1 inlets and 0 outlets"):
        Model(loop)
