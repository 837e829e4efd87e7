"""The lumen that a network without an anatomy implies, against that of the anatomy from which it was built."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.case.anatomy.tree import AORTA
from coronaryuq.case.assembly import assemble
from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.lumen.implied import implied_lumen
from coronaryuq.case.lumen.law import lumen_law
from coronaryuq.case.lumen.profiles import LUMEN, lumen_of, with_lumen
from coronaryuq.case.network.along_tree import vessels_along
from coronaryuq.case.network.build import Physics
from coronaryuq.case.network.network import UNCERTAIN
from coronaryuq.case.network.schematic import schematic_tree
from coronaryuq.case.network.throats import SHORTEST_THROAT, Bore, implied_bore
from coronaryuq.case.network.topology import CORONARY, closed_loop_tree
from coronaryuq.case.settings import STENOSIS_LOSS, Settings
from support.random_trees import network_of, tube
from support.small_loop import loop

COMMON = LumenError(unit="mm", common_sd=0.15, local_sd=0.0)
BLOOD = Physics()
Z = {"lumen_common": np.array([-1.5, 0.0, 1.5])}


def implied(network):
    topology = closed_loop_tree(network, "network")
    branches = {bc: "LAD" for bc in topology.vessel_of if topology.kind(bc) in CORONARY}
    tree = schematic_tree(topology, BLOOD.density, branches)
    return implied_lumen(tree, topology, BLOOD.density, BLOOD.viscosity)


@pytest.mark.parametrize("severity", [0.4, 0.6])
def test_a_draw_changes_the_network_as_with_the_anatomy(severity):
    tree, stenoses = tube(severity=severity)
    network = network_of(tree, stenoses)
    known = with_lumen(network, tree, vessels_along(tree, stenoses, network), lumen_law(tree, stenoses, COMMON))
    own = implied(network)
    found = with_lumen(network, own.tree, own.segments, lumen_law(own.tree, own.stenoses, COMMON))
    expected, factors = (lumen_of(each).factors(Z) for each in (known, found))
    narrowed = stenoses[0].vessel + "_seg1"
    for name in ("R_poiseuille", "L"):
        np.testing.assert_allclose(factors[f"LAD_seg0.{name}"], expected[f"LAD_seg0.{name}"], rtol=1e-6)
    # The anatomy narrows as a cosine; a network's elements cannot tell that from a throat with steep ends.
    for name in ("R_poiseuille", "L", "stenosis_coefficient"):
        logs = [np.log(each[f"{narrowed}.{name}"]) for each in (factors, expected)]
        np.testing.assert_allclose(*logs, rtol=0.2, atol=1e-12)


def tube_elements(bore: Bore) -> dict[str, float]:
    """Elements of a tube 1 cm long."""
    q, area = 1.0 / bore.ratio, np.pi * bore.radius**2
    return {
        "R_poiseuille": 8 * BLOOD.viscosity / np.pi / bore.radius**4 * (1 + bore.share * (q**2 - 1)),
        "L": BLOOD.density / area * (1 + bore.share * (q - 1)),
        "stenosis_coefficient": STENOSIS_LOSS * BLOOD.density / (2 * area**2) * (q - 1) ** 2,
    }


@given(radius=st.floats(0.05, 0.3), ratio=st.floats(0.05, 0.9), share=st.floats(0.03, 0.6))
def test_the_bore_of_a_tube_has_the_elements_of_the_tube(radius, ratio, share):
    """Two tubes may have the same elements; the one with the shorter throat is found."""
    given_elements, network = tube_elements(Bore(radius, ratio, share)), loop()
    network.vessel_values("lca1").update(given_elements)
    bore = implied_bore(closed_loop_tree(network, "network"), "lca1", BLOOD.density, BLOOD.viscosity)
    assert tube_elements(bore) == pytest.approx(given_elements, rel=1e-6)
    assert bore.share <= share * (1 + 1e-6)


def test_elements_of_no_tube_still_give_a_throat():
    network = loop()
    network.vessel_values("lca1").update(R_poiseuille=1.0, L=2.0, stenosis_coefficient=50.0)
    bore = implied_bore(closed_loop_tree(network, "network"), "lca1", BLOOD.density, BLOOD.viscosity)
    assert bore.radius == pytest.approx(np.sqrt(BLOOD.density / (2.0 * np.pi)))
    assert bore.share == SHORTEST_THROAT and 0.0 < bore.ratio < 1.0


def test_the_aorta_and_vessels_of_no_known_size_are_taken_as_known():
    network = loop()
    for name in ("R_poiseuille", "L"):
        network.vessel_values("lca2")[name] = 0.0
    own = implied(network)
    assert {v.name for v in own.tree if v.branch != AORTA} == {"lca1"}


def test_without_an_inertance_the_resistance_gives_the_radius():
    network = loop()
    network.vessel_values("lca1")["L"] = 0.0
    own = implied(network)
    expected = (8 * BLOOD.viscosity * 1.0 / (np.pi * 500.0)) ** 0.25
    np.testing.assert_allclose(own.tree["lca1"].radii, expected, rtol=1e-12)


def test_a_case_with_nothing_but_a_network_has_an_uncertain_lumen(tmp_path):
    (tmp_path / "network.json").write_text(json.dumps(loop()))
    (tmp_path / "outlets.csv").write_text("name,perfuses,branch\nlca1,LV,LAD\nlca2,LV,LCx\n")
    (tmp_path / "flows.csv").write_text("name,flow\nlca1,0.6\nlca2,0.4\n")
    (tmp_path / "targets.csv").write_text("PaoMean,Mean Aortic Pressure,90\nAbsQin,Stroke Volume,70\n")
    (tmp_path / "case.yaml").write_text(
        "name: two beds\nnetwork: network.json\noutlets: outlets.csv\ntargets: targets.csv\nstenoses: []\n"
        "territory_flows: {file: flows.csv, unit: fraction, total: 3.0}\n"
    )
    known, uncertain = (assemble(tmp_path / "case.yaml", Settings(), which).network for which in ("paper", "full"))
    assert LUMEN not in known and UNCERTAIN not in known
    assert set(uncertain[LUMEN]["profiles"]) == {"lca1", "lca2"}
    names = [entry["name"] for entry in uncertain[UNCERTAIN]]
    assert names[0] == "lumen_common" and {"lumen_LAD_rest", "lumen_LCx_rest"} <= set(names)
