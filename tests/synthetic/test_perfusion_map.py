"""The perfusion map has the flows that are asked for, and a texture of the stated statistics."""

import numpy as np
import pytest

from coronaryuq.synthetic.perfusion_map import perfusion_map, territories, texture


@pytest.fixture(scope="module")
def cells():
    """Centres (cm) and masses (g) of random cells around three outlets (cm)."""
    random = np.random.default_rng(5)
    outlets = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0]])
    return random.uniform(-2.0, 5.0, (4000, 3)), random.uniform(0.5, 1.5, 4000), outlets


def test_the_map_integrates_to_the_flow_of_every_outlet(cells):
    centres, masses, outlets = cells
    flows = np.array([40.0, 55.0, 48.0])
    flow = masses * perfusion_map(centres, masses, outlets, flows, texture(centres, 0.1, 1.0, seed=3))
    owner = territories(centres, outlets)
    assert np.bincount(owner, weights=flow) == pytest.approx(flows, rel=1e-12)


def test_flows_that_no_positive_map_has_are_rejected(cells):
    centres, masses, outlets = cells
    with pytest.raises(ValueError, match="no positive perfusion map"):
        perfusion_map(centres, masses, outlets, np.array([40.0, 1e-3, 48.0]), np.ones(len(centres)))


@pytest.mark.slow
def test_texture_has_the_stated_mean_and_deviation_and_follows_position_only(cells):
    centres = cells[0]
    fields = np.array([texture(centres, 0.2, 0.5, seed) for seed in range(200)])
    assert fields.mean() == pytest.approx(1.0, abs=0.01)
    assert fields.std() == pytest.approx(0.2, rel=0.05)
    assert texture(centres[::7], 0.2, 0.5, seed=11) == pytest.approx(fields[11, ::7], rel=1e-12)
