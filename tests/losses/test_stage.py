"""Losses learnt from runs of a loop whose vessels have known other losses, in place of 3D runs."""

import json

import numpy as np
import pytest

from coronaryuq.case.network.network import Network
from coronaryuq.core import records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.units import BLOOD_DENSITY
from coronaryuq.losses.own_losses import for_3d
from coronaryuq.losses.places import edges, places
from coronaryuq.losses.stage import learn_losses
from coronaryuq.zerod.network.changes import with_changes
from coronaryuq.zerod.network.read import read_network, write_network
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.theta import theta_changes
from support.case_files import case_summary, write_case_json
from support.small_loop import loop, mesh_of_part

AORTA = "J_heart_outlet:aorta"
OUTSIDE = 0.3
"""Fraction of lca1 behind the outlet of the 3D domain."""
TRUTH = {
    "lca1.R_poiseuille": 500.0 * (OUTSIDE + (1.0 - OUTSIDE) * 1.6),
    "lca1.stenosis_coefficient": 400.0,
    "lca2.R_poiseuille": 300.0,
    "lca2.stenosis_coefficient": 900.0,
}
"""The domain is the first part of lca1, with 1.6 of its resistance, and the whole of lca2."""


MESH = mesh_of_part({"R_poiseuille": OUTSIDE, "L": OUTSIDE, "stenosis_coefficient": 0.0})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files of the rule, with runs of the loop with `TRUTH` as records."""
    folder, network = tmp_path_factory.mktemp("losses"), loop()
    truth = Engine(with_changes(network, TRUTH))
    random = np.random.default_rng(2)
    theta = {name: random.uniform(0.15, 0.5, 8) for name in ("BC_lca1", "BC_lca2")}
    at = ("J0:lca1", "lca1:BC_lca1", "J0:lca2", "lca2:BC_lca2", AORTA)
    result = truth.run_to_periodic(
        theta_changes(network, theta), [f"mean_{kind}:{one}" for one in at for kind in ("pressure", "flow")]
    )
    pressure, flow = ({one: result.values[f"mean_{kind}:{one}"] for one in at} for kind in ("pressure", "flow"))
    names = {place.name: place.output for place in places(network, MESH, [])}
    outputs = {
        names["outlet_lca1"]: pressure["lca1:BC_lca1"] + OUTSIDE * 500.0 * flow["lca1:BC_lca1"],
        names["outlet_lca2"]: pressure["lca2:BC_lca2"],
        "aortic_pressure": pressure[AORTA],
    }
    found = [
        records.Record(f"losses_{k:05d}", {n: v[k] for n, v in theta.items()}, {n: v[k] for n, v in outputs.items()})
        for k in range(8)
    ]
    records.write(folder / "runs.jsonl", found)
    write_json(folder / "mesh.json", MESH.content())
    write_network(folder / "loop.json", network)
    write_case_json(folder / "case.json", outlets=[{"name": "lca1"}, {"name": "lca2"}], aorta={"pressure": AORTA})
    learn(folder, folder / "runs.jsonl", folder)
    return folder


def learn(folder, runs, out):
    files = (folder / "case.json", folder / "loop.json", folder / "loop.json", folder / "mesh.json", runs)
    learn_losses(*files, out / "network.json", out / "losses.csv", out / "fit.json")


def element(network: Network, name: str) -> float:
    vessel, _, key = name.partition(".")
    return network.vessel_values(vessel)[key]


def test_the_losses_of_the_truth_are_found(folder):
    network = read_network(folder / "network.json")
    for name, value in TRUTH.items():
        assert element(network, name) == pytest.approx(value, rel=0.01), name
    rms = json.loads((folder / "fit.json").read_text())["rms"]
    for cap_name in ("outlet_lca1", "outlet_lca2"):
        assert rms[cap_name]["left_out"] < 1e-4 < 0.01 < rms[cap_name]["before"]


def test_every_loss_has_a_size_and_certain_ones_a_meaning(folder):
    table = read_csv(folder / "losses.csv").set_index(["vessels", "loss"])
    assert table.loc[("lca1", "linear"), "own"] == pytest.approx((1 - OUTSIDE) * 500.0)
    assert table.loc[("lca1", "linear"), "added"] == pytest.approx(0.6 * (1 - OUTSIDE) * 500.0, rel=0.01)
    assert table.loc[("lca1", "linear"), "meaning"] == "more friction than a straight tube's"
    assert table.loc[("lca2", "linear"), "meaning"] == "less friction than a straight tube's"
    assert table.loc[("lca2", "quadratic"), "meaning"] == "separation, turbulence or a narrowing vessel"


def test_3d_runs_are_coupled_to_vessels_with_their_own_losses(folder):
    for_3d(folder / "network.json", folder / "fit.json", folder / "in_3d.json")
    coupled, own = read_network(folder / "in_3d.json"), loop()
    for name in TRUTH:
        assert element(coupled, name) == pytest.approx(element(own, name) if "R_" in name else 0.0)


def test_failed_runs_are_left_out_and_too_few_are_refused(folder, tmp_path):
    lines = (folder / "runs.jsonl").read_text().splitlines()
    failed = [
        json.dumps(json.loads(line) | {"status": "failed", "reason": "diverged", "outputs": {}}) for line in lines
    ]
    (tmp_path / "runs.jsonl").write_text("\n".join(failed[:2] + lines[2:]) + "\n")
    learn(folder, tmp_path / "runs.jsonl", tmp_path)
    assert json.loads((tmp_path / "fit.json").read_text())["runs"] == 6
    (tmp_path / "runs.jsonl").write_text("\n".join(failed[:6] + lines[6:]) + "\n")
    with pytest.raises(InputError, match=r"fewer than 3 3D runs succeeded.*losses.runs_3d: 0"):
        learn(folder, tmp_path / "runs.jsonl", tmp_path)


def test_pieces_end_at_places_and_branchings():
    network = loop()
    compared = places(network, MESH, case_summary(stenoses=[]).stenoses)
    pieces = edges(network, MESH, compared)
    assert [(piece.vessels, piece.outside, piece.carrier) for piece in pieces] == [
        (("lca1",), (OUTSIDE,), "lca1"),
        (("lca2",), (0.0,), "lca2"),
    ]
    assert [round(place.resistance) for place in compared] == [150, 0]


def test_pressures_have_the_names_that_3d_records_give_them():
    """A record names a cap by the 0D connection that it cuts, or by itself where it cuts a vessel."""
    named = [place.output for place in places(loop(), MESH, [])]
    connections = ["outlet_lca1:lca1", "lca2:BC_lca2"]
    assert named == [f"mean_pressure:{connection}" for connection in connections]


def test_a_vessel_gives_back_no_more_than_the_kinetic_energy_that_enters_it(folder, tmp_path):
    """FFR along an artery rose above 1 where a quadratic loss was free to fit what other pieces did not."""
    lines = [json.loads(line) for line in (folder / "runs.jsonl").read_text().splitlines()]
    name = next(place.output for place in places(loop(), MESH, []) if place.name == "outlet_lca2")
    for line in lines:
        line["outputs"][name] = 1.05 * line["outputs"]["aortic_pressure"]
    (tmp_path / "runs.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    learn(folder, tmp_path / "runs.jsonl", tmp_path)
    values = read_network(tmp_path / "network.json").vessel_values("lca2")
    length, inertance = 1.0, 1.0
    area = BLOOD_DENSITY * length / inertance

    assert values["stenosis_coefficient"] == pytest.approx(-BLOOD_DENSITY / area**2, rel=1e-6)
    assert values["R_poiseuille"] == pytest.approx(0.0, abs=1e-6)
