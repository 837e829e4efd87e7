"""What a draw of the lumen does to the 0D network: the same as building the network from the drawn tree."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.lumen.law import lumen_law
from coronaryuq.case.lumen.profiles import LUMEN, lumen_of, with_lumen
from coronaryuq.case.network.along_tree import vessels_along
from coronaryuq.case.network.build import Bed, Physics, network_from_tree, segments
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.seeds import generator
from support.random_trees import network_of, random_tree, tube

ELASTIC = Physics(elastic=True)


def built(tree: Tree, stenoses):
    return network_from_tree(tree, [Bed(f"BC_{v.name}", v.name, False) for v in tree.leaves()], {}, stenoses, ELASTIC)


@given(seed=st.integers(0, 30), scale=st.floats(0.0, 2.0))
@settings(max_examples=15)
def test_factors_are_the_ratios_of_networks_built_from_the_drawn_and_the_segmented_tree(seed, scale):
    tree, stenoses = random_tree(seed)
    law = lumen_law(tree, stenoses, LumenError(bias=0.1))
    network = built(tree, stenoses)
    held = with_lumen(network, tree, vessels_along(tree, stenoses, network), law)
    z = {name: scale * value for name, value in zip(law.names, generator(seed, "z").normal(size=40), strict=False)}
    factors = lumen_of(held).factors({name: np.array([0.0, value]) for name, value in z.items()})
    drawn = built(law.tree(tree, z), stenoses)
    for block in {part.name for part in segments(tree, stenoses)}:
        old, new = held.vessel_values(block), drawn.vessel_values(block)
        assert all(factors[f"{block}.{name}"][0] == 1.0 for name in ("R_poiseuille", "L", "C"))
        for name in ("R_poiseuille", "L", "C"):
            assert old[name] * factors[f"{block}.{name}"][1] == pytest.approx(new[name], rel=1e-9)
        if old["stenosis_coefficient"] > 0:
            changed = old["stenosis_coefficient"] * factors[f"{block}.stenosis_coefficient"][1]
            assert changed == pytest.approx(new["stenosis_coefficient"], rel=1e-7)


def test_without_noise_the_network_is_left_alone_and_with_a_bias_it_is_that_of_the_shifted_lumen():
    tree, stenoses = tube(severity=0.5)
    network = built(tree, stenoses)
    along = vessels_along(tree, stenoses, network)
    exact = LumenError(common_sd=0.0, local_sd=0.0)
    assert with_lumen(network, tree, along, lumen_law(tree, stenoses, exact)) is network
    law = lumen_law(tree, stenoses, exact.model_copy(update={"bias": 0.1, "unit": "mm"}))
    held, wider = with_lumen(network, tree, along, law), built(law.tree(tree, {}), stenoses)
    assert wider.vessel_values("LAD_seg0")["R_poiseuille"] < 0.8 * network.vessel_values("LAD_seg0")["R_poiseuille"]
    for block in ("LAD_seg0", "LAD_seg1", "LAD"):
        assert held.vessel_values(block) == pytest.approx(wider.vessel_values(block), rel=1e-9)


@given(first=st.floats(0.05, 0.4), second=st.floats(0.5, 0.95))
@settings(max_examples=20)
def test_the_parts_of_a_vessel_add_up_to_the_whole(first, second):
    """What lies outside a 3D domain has the resistance of its own stretch, not a fixed fraction of the vessel's."""
    tree, _ = tube()
    law = lumen_law(tree, [], LumenError())
    network = network_of(tree, [])
    lumen = lumen_of(with_lumen(network, tree, vessels_along(tree, [], network), law))
    (profile,) = lumen.profiles.values()
    z = {name: np.array([1.3]) for name in lumen.names}
    ends = [0.0, first * 3.0, second * 3.0, 3.0]
    total = 0.0
    for start, end in zip(ends, ends[1:], strict=False):
        part = profile.between(start, end)
        # Over the segmented tube, whose radius is constant, so that each part has its share of the length.
        total += part.centre()["R_poiseuille"] * part.factors(z)["R_poiseuille"][0] * (end - start) / 3.0
    whole = profile.centre()["R_poiseuille"] * profile.factors(z)["R_poiseuille"][0]
    assert total == pytest.approx(whole, rel=1e-9)


def test_the_ratio_along_a_vessel_is_that_of_the_law_across_its_0d_vessels():
    tree, stenoses = tube(severity=0.5)
    law = lumen_law(tree, stenoses, LumenError())
    network = network_of(tree, stenoses)
    lumen = lumen_of(with_lumen(network, tree, vessels_along(tree, stenoses, network), law))
    z = {name: np.array([0.4, -1.1]) for name in lumen.names}
    arc = np.linspace(0.0, 3.0, 57)
    np.testing.assert_allclose(lumen.ratio("LAD", arc, z), law.ratio("LAD", arc, z), rtol=1e-12)
    assert np.array_equal(lumen.ratio("elsewhere", arc, z), np.ones((2, 57)))


def test_profiles_survive_a_network_file_to_the_bit_and_a_broken_one_is_refused(tmp_path):
    tree, stenoses = tube(severity=0.5)
    network = network_of(tree, stenoses)
    assert lumen_of(network) is None
    held = with_lumen(network, tree, vessels_along(tree, stenoses, network), lumen_law(tree, stenoses, LumenError()))
    write_json(tmp_path / "network.json", held)
    again, lumen = lumen_of(read_json(tmp_path / "network.json")), lumen_of(held)
    z = {name: np.array([0.7]) for name in lumen.names}
    assert again.factors(z) == lumen.factors(z)
    held[LUMEN]["profiles"]["LAD"].pop("radii")
    with pytest.raises(InputError, match="radii"):
        lumen_of(held, "network.json")


def test_a_draw_does_not_depend_on_the_others_nor_a_vessel_on_those_beside_it():
    tree, stenoses = random_tree(5)
    network = built(tree, stenoses)
    law = lumen_law(tree, stenoses, LumenError())
    lumen = lumen_of(with_lumen(network, tree, vessels_along(tree, stenoses, network), law))
    drawn = generator(1, "z").normal(size=(9, len(law.names)))
    together = lumen.factors(dict(zip(law.names, drawn.T, strict=True)))
    alone = lumen.factors(dict(zip(law.names, drawn[4:5].T, strict=True)))
    assert all(np.array_equal(together[name][4:5], alone[name]) for name in together)
    for block, profile in lumen.profiles.items():
        for name, factor in profile.factors(dict(zip(law.names, drawn.T, strict=True))).items():
            assert np.allclose(factor, together[f"{block}.{name}"], rtol=1e-13)
