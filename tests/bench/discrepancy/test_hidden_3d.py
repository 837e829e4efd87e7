"""Measurements from the 3D solver: the vessel's shape, what 3D data say of it, and a search that finds it."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy import hidden_3d, trial
from coronaryuq.bench.discrepancy.hidden_3d import NARROWED, PLACES, SHAPES, STENOSES, Shape
from coronaryuq.case.network.build import Physics


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.label)
def test_a_shape_is_healthy_at_both_ends_and_as_narrow_as_stated(shape):
    radius = shape.radius(np.linspace(0.0, 1.0, 2001))
    least = {"healthy": 1.0, "narrowed": NARROWED}.get(shape.kind) or STENOSES[shape.kind]
    assert radius[[0, -1]] == pytest.approx(1.0) and radius.min() == pytest.approx(least)


def test_the_healthy_tube_is_the_vessel_of_the_0d_model():
    """Poiseuille's resistance and the inertance of the 3D tube are those of the 0D vessel."""
    experiment = hidden_3d.loop_3d()
    network, plan = experiment.network, experiment.plan
    physics = Physics()
    for place in PLACES:
        values, radius = network.vessel_values(place), hidden_3d.healthy_radius(network, place)
        exact = 8 * physics.viscosity * hidden_3d.LENGTH / (np.pi * radius**4)
        assert values["R_poiseuille"] == pytest.approx(exact, rel=1e-6) and values["stenosis_coefficient"] == 0.0
        assert values["L"] == pytest.approx(physics.density * hidden_3d.LENGTH / (np.pi * radius**2), rel=1e-6)
    assert len({entry[:3] for entry in plan.entries}) == len(plan.entries)


def test_3d_runs_start_from_the_published_loss():
    """Young and Tsai's loss of a 75 % stenosis in the healthy vessel: 9 times K_t rho / (2 A^2)."""
    network = hidden_3d.loop_3d().network
    physics = Physics()
    for place in PLACES:
        area = np.pi * hidden_3d.healthy_radius(network, place) ** 2
        near = hidden_3d.shape_in_0d(Shape(place, "moderate"), network).vessel_values(place)
        exact = 9.0 * physics.stenosis_loss * physics.density / (2.0 * area**2)
        assert near["stenosis_coefficient"] == pytest.approx(exact, rel=1e-6)


@pytest.mark.long
def test_a_stenosis_in_3d_is_found_and_a_healthy_vessel_raises_no_alarm():
    """Two vessels in 3D under four conditions each; the search reads the 0D model without them and the table alone."""
    found = {e["shape"]: e for e in trial.trials_3d(range(9101, 9102), ("lca1:severe", "lca1:healthy"))}
    severe, healthy = found["lca1:severe"], found["lca1:healthy"]
    assert not healthy["alarmed"] and healthy["first"] == "none"
    assert "stenosis_with_viscous_loss@lca1" in [member for members in severe["classes"] for member in members]
    assert severe["after"] < severe["before"]


def test_labels_are_distinct():
    assert len({shape.label for shape in SHAPES}) == len(SHAPES)
    assert Shape(PLACES[0], "healthy").effects == ()
