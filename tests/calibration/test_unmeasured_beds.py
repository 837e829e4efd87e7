"""What is assumed of beds without measured flow: Murray's law on the drawn lumen, its exponent, and their spread."""

import numpy as np
import pytest

from coronaryuq.calibration.unmeasured_beds import median_radii, unmeasured_parameters
from coronaryuq.case.case_json import CaseOutlet
from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.case.lumen.law import lumen_law
from coronaryuq.case.lumen.profiles import with_lumen
from coronaryuq.case.network.build import Bed, Physics, murray_shares, network_from_tree, segments
from coronaryuq.case.network.network import UNCERTAIN, Network
from coronaryuq.case.network.parameter_names import UNMEASURED
from coronaryuq.case.settings import MURRAY_EXPONENT
from coronaryuq.core.seeds import generator
from coronaryuq.synthetic.anatomy import patient_anatomy
from coronaryuq.synthetic.arteries import PATTERNS, Lesion
from coronaryuq.zerod.network.beds import beds
from coronaryuq.zerod.theta import Theta

ALONE = RoutineErrors(microvascular=0.0)


@pytest.fixture(scope="module")
def anatomy():
    return patient_anatomy(11, "right", (Lesion("RCA", PATTERNS["right"].right, 1.5, 0.9, 0.5),))


@pytest.fixture(scope="module")
def outlets(anatomy):
    return [
        CaseOutlet(
            name=o.vessel, label=o.vessel, bc=f"BC_{o.vessel}", vessel=o.vessel, block=o.vessel, perfuses=o.perfuses,
            branch=o.branch, point=(0, 0, 0), radius=float(anatomy.tree[o.vessel].radii[-1]),
        )
        for o in anatomy.outlets
    ]  # fmt: skip


def network_of(anatomy, outlets, error):
    tree, stenoses = anatomy.tree, anatomy.stenoses
    named = [Bed(outlet.bc, outlet.vessel, outlet.branch == "RCA") for outlet in outlets]
    plain = network_from_tree(tree, named, {"BC_RCR1": "aorta_outlet"}, stenoses, Physics())
    law = lumen_law(tree, stenoses, error)
    return with_lumen(plain, tree, segments(tree, stenoses), law), law


def with_parameters(network, outlets, errors, exponent=MURRAY_EXPONENT):
    entries = unmeasured_parameters(outlets, network, errors, exponent)
    return Theta(Network(network | {UNCERTAIN: [*network[UNCERTAIN], *entries]}))


def conductance(theta, values, outlets):
    """Return conductance of each outlet's bed over that at the centre, (samples,) of each."""
    own, changed = theta.network, theta.changes(values)
    return {o.bc: own.bed_values(o.bc)["Ra"] / changed.get(f"{o.bc}.Ra", own.bed_values(o.bc)["Ra"]) for o in outlets}


def drawn_shares(anatomy, law, outlets, z, exponent):
    """Return the share of each artery's unmeasured outlets over that of all measured ones, by Murray's law."""
    samples = len(next(iter(z.values())))
    weights = np.array([
        (law.ratio(o.vessel, [anatomy.tree[o.vessel].length], z)[:, 0] * o.radius) ** exponent for o in outlets
    ])  # fmt: skip
    assert weights.shape == (len(outlets), samples)
    measured = np.array([o.perfuses == "LV" for o in outlets])
    return {
        artery: weights[[not m and o.branch == artery for m, o in zip(measured, outlets, strict=True)]].sum(axis=0)
        / weights[measured].sum(axis=0)
        for artery in dict.fromkeys(o.branch for o in outlets if o.perfuses != "LV")
    }


@pytest.mark.parametrize("exponent", [MURRAY_EXPONENT, 3.0])
def test_conductance_beside_the_measured_beds_follows_murrays_law_on_the_drawn_lumen(anatomy, outlets, exponent):
    network, law = network_of(anatomy, outlets, LumenError(local_sd=0.05, common_sd=0.05))
    theta = with_parameters(network, outlets, ALONE, exponent)
    random = generator(1, "lumens")
    z = {name: random.standard_normal(200) for name in law.names}
    laws = theta.laws
    coordinates = np.zeros((200, len(laws)))
    for name, value in z.items():
        coordinates[:, laws.names.index(name)] = value
    values = dict(zip(laws.names, laws.values(coordinates).T, strict=True))
    found = conductance(theta, values, outlets)
    wanted = drawn_shares(anatomy, law, outlets, z, exponent)
    median = drawn_shares(anatomy, law, outlets, {name: np.zeros(1) for name in law.names}, exponent)
    assert "RCA" in wanted
    for artery, share in wanted.items():
        bed = next(o.bc for o in outlets if o.branch == artery and o.perfuses != "LV")
        expected = np.log(share / median[artery])
        assert expected.std() > 0.03
        # Linear in the logarithms: what is left is of second order in errors of some 5 %.
        np.testing.assert_allclose(np.log(found[bed]), expected, atol=0.25 * expected.std())
        assert np.corrcoef(np.log(found[bed]), expected)[0, 1] > 0.98
    assert all(np.all(found[o.bc] == 1.0) for o in outlets if o.perfuses == "LV")


def test_the_exponent_moves_the_share_of_each_outlet_beside_the_measured_ones(anatomy, outlets):
    network, law = network_of(anatomy, outlets, LumenError())
    theta = with_parameters(network, outlets, ALONE)
    change = 0.01
    found = conductance(theta, {"murray_exponent": np.exp([change])}, outlets)
    radii = np.array(median_radii(outlets, network))
    measured = np.array([o.perfuses == "LV" for o in outlets])

    def share(exponent):
        weights = murray_shares(radii, exponent)
        return weights / weights[measured].sum()

    expected = share(MURRAY_EXPONENT + change) / share(MURRAY_EXPONENT)
    for outlet, value in zip(outlets, expected.tolist(), strict=True):
        if outlet.perfuses != "LV":
            assert np.log(found[outlet.bc][0]) == pytest.approx(np.log(value), abs=2e-5)


def test_a_known_lumen_leaves_the_spread_of_conductance_among_beds(anatomy, outlets):
    network, _ = network_of(anatomy, outlets, LumenError(local_sd=0.0, common_sd=0.0))
    entries = {one["name"]: one for one in unmeasured_parameters(outlets, network, RoutineErrors(murray_exponent=0.0))}
    assert set(entries) == {UNMEASURED + o.branch for o in outlets if o.perfuses != "LV"}
    for name, entry in entries.items():
        own = [o for o in outlets if UNMEASURED + o.branch == name and o.perfuses != "LV"]
        assert 0.25 * np.sqrt(0.5 + 0.5 / len(own)) - 1e-9 <= entry["spread"] <= 0.25
        assert set(entry["targets"]) == {f"{o.bc}.{key}" for o in own for key in beds(network)[o.bc].resistances}
        assert "loadings" not in entry
    assert median_radii(outlets, network) == [o.radius for o in outlets]


def test_nothing_is_assumed_where_all_flow_is_measured(anatomy, outlets):
    network, _ = network_of(anatomy, outlets, LumenError())
    measured = [outlet for outlet in outlets if outlet.perfuses == "LV"]
    assert unmeasured_parameters(measured, network, RoutineErrors()) == []
    nothing = RoutineErrors(microvascular=0.0, murray_exponent=0.0)
    exact, _ = network_of(anatomy, outlets, LumenError(local_sd=0.0, common_sd=0.0))
    assert unmeasured_parameters(outlets, exact, nothing) == []
