"""The case stage: four files that say the same as the case they were made from."""

import json
import shutil

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.case.anatomy.tree import read_tree
from coronaryuq.case.case_json import read_case
from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import closed_loop_tree
from coronaryuq.case.network.units import rescaled
from coronaryuq.case.settings import Settings
from coronaryuq.case.stage import prepare_case
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MBF_PER_MIN_PER_G, MMHG
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.theta import Theta
from support.case_files import check_case, write_case


def test_the_four_files_agree_with_one_another(small_tree, tmp_path):
    prepare_case(write_case(tmp_path, small_tree, period="0.8"), Settings(), tmp_path / "case")
    case = json.loads((tmp_path / "case/case.json").read_text())
    network = json.loads((tmp_path / "case/network.json").read_text())
    tree = read_tree(tmp_path / "case/tree.vtp")
    wall = pv.read(tmp_path / "case/lv.vtu")
    graph = closed_loop_tree(network, "network.json")
    assert case["period"] == graph.network.heart["cardiac_cycle_period"] == 0.8
    assert case["aorta"] == {"pressure": "J_heart_outlet:aorta", "made": False}
    for outlet in case["outlets"]:
        assert graph.outlet_bc[outlet["block"]] == outlet["bc"]
        assert tree[outlet["vessel"]].points[-1].tolist() == outlet["point"]
        assert tree[outlet["vessel"]].radii[-1] == outlet["radius"]
    (stenosis,) = case["stenoses"]
    assert graph.outlet(stenosis["segment"]) == "lca1_seg1:J3" and stenosis["ffr"] == graph.outlet("lca1_seg2")
    assert stenosis["flow"] == graph.inlet("lca1_seg1")
    assert stenosis["root"] == graph.inlet("lca1_seg0")
    assert (stenosis["proximal"], stenosis["distal"], stenosis["outlet"]) == ("lca1_seg0", "lca1_seg2", "BC_lca1")
    assert np.allclose(wall.cell_data["MBF"], 2.0 * MBF_PER_MIN_PER_G, rtol=1e-12)
    assert wall.cell_data["Volume"].sum() == pytest.approx(wall.volume, rel=1e-6)
    assert case["targets"]["PaoMean"] == {"description": "Mean Aortic Pressure", "value": 90.0, "unit": "mmHg"}
    assert case["targets"]["QlaRatio"]["value"] is None


@pytest.mark.parametrize(("lines", "noted"), [({}, True), ({"period": "0.8"}, False)])
def test_an_assumed_heart_rate_is_said(small_tree, tmp_path, lines, noted):
    _, summary = check_case(write_case(tmp_path, small_tree, **lines))
    note = "note: heart rate is not given: a period of 1 s (60 beats per minute), assumed; give HR (1/min)"
    assert (note in summary) is noted


def test_nothing_is_written_when_the_case_is_wrong(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree, targets="absent.csv")
    with pytest.raises(InputError, match="targets = .absent.csv.: no such file"):
        prepare_case(path, Settings(), tmp_path / "case")
    assert not (tmp_path / "case").exists()


def test_the_same_case_gives_the_same_bytes(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree)
    for folder in ("one", "two"):
        prepare_case(path, Settings(), tmp_path / folder)
    for name in ("case.json", "tree.vtp", "network.json", "lv.vtu"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes(), name


def test_full_uncertainty_adds_the_lumen_and_the_errors_and_the_papers_setting_nothing(small_tree, tmp_path):
    lumen = "{unit: mm, common_sd: 0.02, local_sd: 0.05}"
    path = write_case(tmp_path, small_tree, lumen=lumen, errors="{pressure: 4.0}")
    for uncertainty in ("paper", "full"):
        prepare_case(path, Settings(), tmp_path / uncertainty, uncertainty)
    case, network = (json.loads((tmp_path / "full" / name).read_text()) for name in ("case.json", "network.json"))
    assert case["errors"]["pressure"] == 4.0 and case["errors"]["pressure_correlation"] == 0.7
    theta = Theta(read_network(tmp_path / "full/network.json"))
    assert theta.laws.names[0] == "lumen_common" and theta.laws.names == network["lumen"]["names"]
    wider, own = theta.changes({"lumen_common": np.array([2.0])}), Network(network).vessel_values("lca1")
    assert wider["lca1.R_poiseuille"][0] < 0.99 * own["R_poiseuille"]
    plain = json.loads((tmp_path / "paper/network.json").read_text())
    assert "lumen" not in plain and "uncertain_parameters" not in plain
    assert json.loads((tmp_path / "paper/case.json").read_text())["errors"] is None
    assert Network(network).for_svzerodsolver().keys() == plain.keys()


def test_a_calcified_stretch_off_the_arteries_is_refused(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree, lumen="{calcified: [{vessel: nowhere, start: 0.5, end: 1.0}]}")
    with pytest.raises(InputError, match="lumen.calcified.*nowhere"):
        prepare_case(path, Settings(), tmp_path / "case", "full")


def test_targets_may_be_yaml_with_units(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree, targets="targets.yaml")
    (tmp_path / "targets.yaml").write_text("PaoMean: {value: 12, unit: kPa}\nAbsQin: 70\nEFLV: none\n")
    prepare_case(path, Settings(), tmp_path / "case")
    targets = json.loads((tmp_path / "case/case.json").read_text())["targets"]
    assert targets["PaoMean"] == {"description": "Mean aortic pressure", "value": 12.0, "unit": "kPa"}
    assert targets["AbsQin"]["value"] == 70.0 and targets["EFLV"]["value"] is None


def test_measured_territory_flows_come_back_from_their_territories(small_tree, tmp_path):
    path = write_case(
        tmp_path, small_tree, perfusion=None, territory_flows="{file: flows.csv, unit: fraction, total: 4.0}"
    )
    (tmp_path / "flows.csv").write_text("name,flow,volume\nlca1,0.5,50\nlca2,0.3,30\nrca1,0.2,40\n")
    prepare_case(path, Settings(), tmp_path / "case")
    case = json.loads((tmp_path / "case/case.json").read_text())
    wall = pv.read(tmp_path / "case/lv.vtu")
    flows = wall.cell_data["MBF"] * wall.cell_data["Volume"] * case["tissue_density"]
    assert flows == pytest.approx([2.0, 1.2, 0.8], rel=1e-12)
    ends = np.array([outlet["point"] for outlet in case["outlets"]])
    assert np.array_equal(wall.cell_centers().points, ends)


def closed_loop_22(shared, folder):
    """The real network with 22 outlets as a case without anatomy: 17 of them perfuse the LV, equal flows."""
    folder.mkdir(parents=True, exist_ok=True)
    data = shared / "data/closed-loop-22"
    shutil.copy(data / "svzerod_tuning_cgs.json", folder / "network.json")
    shutil.copy(data / "coronary_cgs.csv", folder / "targets.csv")
    graph = closed_loop_tree(json.loads((folder / "network.json").read_text()), "network.json")
    rows = []
    for vessel, bc in graph.outlet_bc.items():
        if "Coronary" in graph.kind(bc):
            left = "LAD" if "branch8_seg0" in graph.path(vessel) else "LCx"
            rows.append((vessel, "RCA" if graph.kind(bc).endswith("Right") else left))
    outside = {"rca1", "rca2", "rca3", "rca4", "rca10"}
    (folder / "outlets.csv").write_text(
        "name,perfuses,branch\n" + "".join(f"{n},{'RV' if n in outside else 'LV'},{b}\n" for n, b in rows)
    )
    lv = [n for n, _ in rows if n not in outside]
    (folder / "flows.csv").write_text("name,flow\n" + "".join(f"{n},{1 / len(lv)}\n" for n in lv))
    (folder / "case.yaml").write_text(
        "name: closed-loop-22\nnetwork: network.json\noutlets: outlets.csv\ntargets: targets.csv\n"
        "territory_flows: {file: flows.csv, unit: fraction, total: 3.0}\n"
        "stenoses: [{name: LCx, block: branch20_seg0}]\n"
    )
    return folder / "case.yaml"


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "5", True])
def test_check_refuses_a_network_that_the_solver_would_refuse(shared, tmp_path, value):
    path = closed_loop_22(shared, tmp_path)
    network = json.loads((tmp_path / "network.json").read_text())
    network["vessels"][0]["zero_d_element_values"]["R_poiseuille"] = value
    (tmp_path / "network.json").write_text(json.dumps(network))
    (finding,) = check_case(path)[0]
    name = network["vessels"][0]["vessel_name"]
    told = f"network.json: vessels.{name}.zero_d_element_values.R_poiseuille = {value!r}: expected a number"
    assert finding.endswith(told)


@pytest.mark.parametrize(("part", "name", "values"), [
    ("vessels", "vessel_name", "zero_d_element_values"), ("boundary_conditions", "bc_name", "bc_values"),
])  # fmt: skip
def test_a_negative_resistance_of_a_given_network_is_refused(shared, tmp_path, part, name, values):
    """The solver takes it, and so did `check`."""
    path = closed_loop_22(shared, tmp_path)
    network = json.loads((tmp_path / "network.json").read_text())
    block = network[part][0]
    key = next(key for key in block[values] if key.startswith("R"))
    block[values][key] = -abs(block[values][key]) - 1.0
    (tmp_path / "network.json").write_text(json.dumps(network))
    (finding,) = check_case(path)[0]
    assert f"network.json: {part}.{block[name]}.{values}.{key} = -" in finding and "cannot be negative" in finding


def test_a_ready_network_needs_no_anatomy(shared, tmp_path):
    path = closed_loop_22(shared, tmp_path)
    findings, summary = check_case(path)
    assert findings == []
    assert "network: 49 vessels, 22 coronary outlets (17 LV, 5 RV), 5 systemic" in summary
    prepare_case(path, Settings(), tmp_path / "case")
    case = json.loads((tmp_path / "case/case.json").read_text())
    given = json.loads((tmp_path / "network.json").read_text())
    assert json.loads((tmp_path / "case/network.json").read_text()) == given
    assert case["schematic"] and case["aorta"]["pressure"] == "J_heart_outlet:aorta"
    assert case["period"] == 0.9231
    assert case["stenoses"][0]["ffr"] == "branch20_seg0:J12"
    radius = {outlet["name"]: outlet["radius"] for outlet in case["outlets"]}
    # ρ l / (π r²) = L of lca1.
    assert 1.06 * 3.33927399 / (np.pi * radius["lca1"] ** 2) == pytest.approx(126.25582734240001, rel=1e-12)


@pytest.mark.parametrize(
    ("stenoses", "expected"),
    [
        (
            "{name: LCx, block: branch20_seg0}, {name: RCA, block: branch20_seg0}",
            "case.yaml: stenoses of LCx and RCA share the 0D vessel branch20_seg0; give each its own block",
        ),
        (
            "{name: RCA, block: branch20_seg0}",
            "case.yaml: stenoses.RCA.block = 'branch20_seg0': feeds LCx; choose a vessel upstream of an RCA outlet",
        ),
        (
            "{name: RCA, block: aorta_outlet}",
            "case.yaml: stenoses.RCA.block = 'aorta_outlet': feeds no coronary outlet; choose a vessel upstream of an "
            "RCA outlet",
        ),
    ],
)
def test_a_block_that_cannot_be_that_stenosis_is_one_line(shared, tmp_path, stenoses, expected):
    path = closed_loop_22(shared, tmp_path)
    path.write_text(path.read_text().replace("{name: LCx, block: branch20_seg0}", stenoses))
    findings, _ = check_case(path)
    assert findings == [f"{tmp_path}/{expected}"]


def test_a_ready_network_in_mmhg_is_the_same_case(shared, tmp_path):
    path = closed_loop_22(shared, tmp_path / "mmhg")
    network = Network(json.loads((tmp_path / "mmhg/network.json").read_text()))
    (tmp_path / "mmhg/network.json").write_text(json.dumps(rescaled(network, 1.0 / MMHG)))
    prepare_case(path, Settings(), tmp_path / "mmhg/case")
    prepare_case(closed_loop_22(shared, tmp_path / "cgs"), Settings(), tmp_path / "cgs/case")
    found, given = (json.loads((tmp_path / unit / "case/case.json").read_text()) for unit in ("mmhg", "cgs"))
    assert set(found["notes"]) - set(given["notes"]) == {"network.json: pressures in mmHg, converted to dyn/cm2"}
    network, given = (json.loads((tmp_path / unit / "case/network.json").read_text()) for unit in ("mmhg", "cgs"))
    for part, key in (("vessels", "zero_d_element_values"), ("boundary_conditions", "bc_values")):
        for block, expected in zip(network[part], given[part], strict=True):
            assert block[key] == pytest.approx(expected[key], rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("lca1,LV,LAD", "lca99,LV,LAD", "bc = 'BC_lca99': network.json has no such coronary bed"),
        ("lca1,LV,LAD", "lca1,LV,RCA", "branch of lca1 = 'RCA': BC_lca1 is a left bed"),
        ("lca1,LV,LAD\n", "", "bc = 'BC_lca1': missing; network.json has this coronary bed"),
    ],
)
def test_a_table_that_does_not_fit_its_network_is_refused(shared, tmp_path, old, new, expected):
    path = closed_loop_22(shared, tmp_path)
    table = (tmp_path / "outlets.csv").read_text()
    assert old in table
    (tmp_path / "outlets.csv").write_text(table.replace(old, new))
    assert expected in check_case(path)[0][0]


def test_a_network_with_a_dangling_vessel_is_refused(shared, tmp_path):
    path = closed_loop_22(shared, tmp_path)
    network = json.loads((tmp_path / "network.json").read_text())
    network["junctions"][3]["outlet_vessels"].pop()
    (tmp_path / "network.json").write_text(json.dumps(network))
    assert "vessel branch19_seg0: nothing feeds it" in check_case(path)[0][0]


def test_the_exponent_of_murrays_law_reaches_the_later_stages(small_tree, tmp_path):
    prepare_case(write_case(tmp_path, small_tree), Settings(murray_exponent=3.0), tmp_path / "case")
    assert read_case(tmp_path / "case/case.json").murray_exponent == 3.0
