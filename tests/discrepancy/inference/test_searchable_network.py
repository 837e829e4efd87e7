"""What a network may be that is searched, the places of its measurements, and tissue masses."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MBF_PER_MIN_PER_G
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.nuisance import tissue_mass
from coronaryuq.discrepancy.hidden.experiment import loop_conditions
from coronaryuq.discrepancy.inference.read_problem import locations, make_problem
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.searchable import check_searchable
from coronaryuq.zerod.network.read import read_network


def _rename(network, part, key, name):
    network[part][-1][key] = name


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda n: n.pop("vessels"), "vessels: missing"),
        (
            lambda n: _rename(n, "vessels", "vessel_name", "la:d"),
            "vessels.vessel_name = 'la:d': expected a name without ':'",
        ),
        (
            lambda n: _rename(n, "vessels", "vessel_name", "branch from lad"),
            "vessels.vessel_name = 'branch from lad': expected a name without 'from'",
        ),
        (lambda n: _rename(n, "boundary_conditions", "bc_name", "BC<1"), "boundary_conditions.bc_name = 'BC<1'"),
        (lambda n: _rename(n, "junctions", "junction_name", "J~1"), "junctions.junction_name = 'J~1'"),
        (
            lambda n: n["vessels"][2].update(
                zero_d_element_type="BloodVesselRC", zero_d_element_values={"Rpd": 1, "Cp": 1}
            ),
            "lad = 'BloodVesselRC': element not supported by the search",
        ),
        (
            lambda n: n["vessels"][0]["zero_d_element_values"].update(R_poiseuille=-1.0),
            "vessels.left_main.R_poiseuille = -1.0: expected a value of zero or more",
        ),
        (
            lambda n: n.update(external_solver_coupling_blocks=[{"name": "IN"}]),
            "external_solver_coupling_blocks.IN: coupled to an external solver",
        ),
    ],
)
def test_networks_that_cannot_be_searched_are_rejected(change, said):
    network = left_coronary()
    network["vessels"][1]["zero_d_element_values"]["stenosis_coefficient"] = -0.05  # learned from 3D runs
    check_searchable(network, "n.json")
    change(network)
    with pytest.raises(InputError) as caught:
        check_searchable(network, "n.json")
    assert str(caught.value).startswith(f"n.json: {said}")


@pytest.mark.parametrize(
    ("rest", "hyperaemia", "expected"),
    [((0.2, 0.3), (2.4, 0.3), "hyperaemia"), ((0.4, 0.3), (2.4, 0.3), "rest"), ((0.0, 0.3), (0.1, 0.5), "hyperaemia")],
)
def test_the_tissue_mass_is_set_by_the_perfusion_with_the_least_relative_noise(rest, hyperaemia, expected):
    experiment = open_loop()
    network, conditions = experiment.network, experiment.conditions
    anatomy = Anatomy(network)
    anatomy.flow = dict.fromkeys(anatomy.vessels, 1.0)
    read = {"rest": rest, "hyperaemia": hyperaemia}
    measured = [
        Measured(name, "perfusion", "BC_lad", "mean", None, 0.85, *(np.array([x * MBF_PER_MIN_PER_G]) for x in pair))
        for name, pair in read.items()
    ]
    flow = anatomy.flow_scale("lad") / conditions[expected].coronary_resistance_scale
    found = tissue_mass("BC_lad", conditions, measured, anatomy)
    assert found == pytest.approx(flow / (max(read[expected]) * MBF_PER_MIN_PER_G))


def test_every_known_location_can_be_measured(shared):
    """Heart and beds have unknowns of their own, and the heart's junctions are places as others are."""
    network = read_network(shared / "data" / "svzerod-cases" / "closedLoopHeart_withCoronaries.json")
    conditions = {"rest": loop_conditions()["rest"]}
    offered = locations(network)
    assert any(name.endswith(":CLH") for name in offered["flow"])
    measured = [
        Measured("rest", quantity, place, "mean", None, 1.0, np.ones(1), np.ones(1))
        for quantity in ("flow", "pressure", "volume")
        for place in offered[quantity]
    ]
    forward = make_problem(network, conditions, measured, Settings(steps_per_cycle=100)).forward
    assert np.isfinite(forward.predict(np.zeros(len(forward.nuisances)))).all()
