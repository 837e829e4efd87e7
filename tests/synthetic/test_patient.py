"""The bundled patient's files are those of a real case."""

import json
from dataclasses import replace

import numpy as np
import pytest
import pyvista
import yaml

from coronaryuq.case.settings import Settings as CaseSettings
from coronaryuq.case.stage import prepare_case
from coronaryuq.core.units import MMHG
from coronaryuq.synthetic.patient import CLINICAL, clinical_targets, description, write_files
from coronaryuq.zerod.cardiac_function import MEASURES


@pytest.fixture(scope="session")
def folder(patient, tmp_path_factory):
    folder = tmp_path_factory.mktemp("patient")
    write_files(patient, folder)
    return folder


@pytest.fixture(scope="session")
def case(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("case")
    prepare_case(folder / "case.yaml", CaseSettings(), out)
    return out


def test_the_case_stage_builds_the_same_vessels(patient, case):
    network = json.loads((case / "network.json").read_text())
    vessels = {v["vessel_name"]: v["zero_d_element_values"] for v in patient.rest.network["vessels"]}
    assert {v["vessel_name"] for v in network["vessels"]} == set(vessels)
    for vessel in network["vessels"]:
        for name, value in vessel["zero_d_element_values"].items():
            assert value == pytest.approx(vessels[vessel["vessel_name"]][name], rel=1e-9)


def test_the_case_files_do_not_contain_the_truth(folder):
    text = (folder / "case.yaml").read_text() + (folder / "outlets.csv").read_text()
    assert "truth" not in text and "resistance" not in text


def test_a_patient_without_a_stenosis_says_so(patient):
    healthy = replace(patient, anatomy=replace(patient.anatomy, stenoses=[]))
    assert yaml.safe_load(description(healthy, "healthy", {}))["stenoses"] == []
    assert yaml.safe_load(description(patient, "ill", {}))["stenoses"] != []


def test_the_map_integrates_to_the_flows_of_the_truth(patient, folder, case):
    truth = json.loads((folder / "truth.json").read_text())
    wall = pyvista.read(case / "lv.vtu")
    total = np.sum(wall.cell_data["MBF"] * wall.cell_data["Volume"]) * 1.05
    assert total == pytest.approx(sum(truth["hyperaemia"]["flows"][bed] for bed in truth["lv_beds"]), rel=1e-6)
    assert truth["effects"] == []


def test_targets_are_rounded_as_in_a_clinical_report(patient):
    rows = {line.split(",")[0]: line.split(",")[-1] for line in clinical_targets(patient.rest.measures).splitlines()}
    assert set(rows) == set(CLINICAL) == set(MEASURES)
    assert rows["mitValveTime"] == "none"
    assert float(rows["PaoMean"]) == round(patient.rest.measures["PaoMean"] / MMHG)
    assert "." not in rows["PaoMax"] and len(rows["EFLV"].split(".")[1]) == 2
