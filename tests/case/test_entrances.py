"""The pressure that the blood takes to enter an artery: Bernoulli's equation, in 0D and at the inlets of a mesh."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.lumen.law import lumen_law
from coronaryuq.case.lumen.profiles import lumen_of, with_lumen
from coronaryuq.case.network.along_tree import vessels_along
from coronaryuq.case.network.entrances import entrance_radius
from coronaryuq.case.settings import Settings
from coronaryuq.case.stage import prepare_case
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import BLOOD_DENSITY
from coronaryuq.flow3d.mesh.coupling.network_without_mesh import remaining_network
from coronaryuq.zerod.network.read import check_network, read_network
from coronaryuq.zerod.solver.engine import Engine
from support.case_files import write_case
from support.ostium import MIDDLE, OSTIAL, artery, entered, entrances, mesh_of, quadratic


@pytest.mark.parametrize("stenosis", [MIDDLE, OSTIAL], ids=["middle", "ostial"])
@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_the_first_vessel_of_an_artery_takes_the_kinetic_energy(stenosis, factor):
    tree = artery(stenosis)
    before, after = entered(tree, stenosis, 0.0), entered(tree, stenosis, factor)
    bernoulli = factor * BLOOD_DENSITY / (2.0 * (np.pi * 0.16**2) ** 2)
    (first,) = entrances(after)
    assert quadratic(after, first) - quadratic(before, first) == pytest.approx(bernoulli, rel=1e-6)
    assert after.vessel(first)["entrance"] == pytest.approx(bernoulli / quadratic(after, first))
    others = [name for name in before.vessel_names.values() if name != first]
    assert all(after.vessel_values(name) == before.vessel_values(name) for name in others)
    check_network(after)


def test_the_static_pressure_in_the_artery_falls_by_it():
    tree = artery(MIDDLE)
    place = "lca1_seg0:J1"
    found = {}
    for factor in (0.0, 2.0):
        network = entered(tree, MIDDLE, factor)
        (place,) = [n.split(":", 1)[1] for n in Engine(network).unknowns if n.startswith("pressure:lca1_seg0:")]
        names = ["mean_pressure:aorta:J0", f"mean_pressure:{place}", f"mean_flow:{place}"]
        values = Engine(network).run_to_periodic({}, names).values
        friction = network.vessel_values("lca1_seg0")["R_poiseuille"] * values[names[2]][0]
        found[factor] = values[names[0]][0] - values[names[1]][0] - friction, values[names[2]][0]
    assert found[0.0][0] == pytest.approx(0.0, abs=0.5)
    drop, flow = found[2.0]
    least = BLOOD_DENSITY * (flow / (np.pi * 0.16**2)) ** 2
    # The mean of a square exceeds the square of the mean; resting coronary flow varies by about its mean.
    assert least < drop < 3.0 * least


def test_a_setting_of_the_case_stage_changes_it(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree)
    for factor in (0.0, 2.0):
        prepare_case(path, Settings(kinetic_factor=factor), tmp_path / f"case_{factor}")
    without, network = (read_network(tmp_path / f"case_{factor}/network.json") for factor in (0.0, 2.0))
    assert entrances(without) == [] and entrances(network) == ["branch1_seg0", "rca1"]
    assert quadratic(network, "rca1") == pytest.approx(BLOOD_DENSITY / (np.pi * 0.15**2) ** 2, rel=0.2)


def test_a_share_beyond_the_coefficient_is_refused():
    network = entered(artery(MIDDLE), MIDDLE)
    network.vessel("lca1_seg0")["entrance"] = 1.2
    with pytest.raises(InputError, match="entrance = 1.2: expected a fraction of the stenosis coefficient"):
        check_network(network)


@given(z=st.floats(-3.0, 3.0))
@examples(max_examples=20)
def test_a_wider_lumen_has_the_entrance_of_the_network_built_from_it(z):
    tree = artery(MIDDLE)
    network = entered(tree, MIDDLE)
    law = lumen_law(tree, [MIDDLE], LumenError(common_sd=0.1, local_sd=0.0))
    held = with_lumen(network, tree, vessels_along(tree, [MIDDLE], network), law)
    (first,) = entrances(held)
    factors = lumen_of(held).factors({name: np.array([z]) for name in law.names})
    drawn = entered(law.tree(tree, dict.fromkeys(law.names, z)), MIDDLE)
    changed = quadratic(held, first) * factors[f"{first}.stenosis_coefficient"][0]
    assert changed == pytest.approx(quadratic(drawn, first), rel=1e-3)


@pytest.mark.parametrize("domain", ["segments", "trees"])
def test_blood_enters_a_mesh_with_the_speed_that_it_has_there(domain):
    tree = artery(MIDDLE)
    network = entered(tree, MIDDLE)
    mesh, radius = mesh_of(tree, network, domain)
    left = remaining_network(network, mesh)
    check_network(left)
    expected = BLOOD_DENSITY / (np.pi * radius["inlet_lca1"] ** 2) ** 2
    assert quadratic(left, "lca1_seg0") == pytest.approx(expected, rel=1e-9)
    flare = radius["inlet_lca1"] / entrance_radius(tree, "lca1")
    assert flare > 1.1 if domain == "trees" else flare == pytest.approx(1.0)
    if domain == "trees":
        assert left.vessel_values("lca1_seg0")["R_poiseuille"] == 0.0


def test_a_mesh_with_the_aorta_speeds_the_blood_up_itself():
    tree = artery(MIDDLE)
    network = entered(tree, MIDDLE)
    mesh, _ = mesh_of(tree, network, "whole")
    assert "lca1_seg0" in mesh.replaces
    assert all(quadratic(remaining_network(network, mesh), v["vessel_name"]) == 0.0 for v in
               remaining_network(network, mesh).vessels)  # fmt: skip
