"""`case.yaml`: a sound one is read, each mistake is one line that says where and what is allowed."""

import re
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.assembly import assemble
from coronaryuq.case.case_json import CaseOutlet
from coronaryuq.case.description.fields import read_description, schema
from coronaryuq.case.description.reference import reference
from coronaryuq.case.perfusion.outlet_checks import outlet_notes
from coronaryuq.case.perfusion.perfusion_map import Wall
from coronaryuq.case.settings import Settings
from coronaryuq.case.tables.read import read_case_targets, read_outlets
from coronaryuq.case.tables.targets import names_reference
from support.case_files import check_case, write_case


def test_a_sound_case_has_no_findings_and_says_what_it_holds(small_tree, tmp_path):
    findings, summary = check_case(write_case(tmp_path, small_tree))
    assert findings == []
    text = "\n".join(summary)
    assert "3 coronary outlets (3 LV), 1 systemic" in text
    assert "2.00 mL/min/g" in text
    assert "targets: PaoMean 90 mmHg, AbsQin 70 mL" in text


MISTAKES = {
    "unknown field": ({"heartrate": "60"}, "heartrate = 60: unknown field; known fields: name, description"),
    "unknown field inside": (
        {"perfusion": "{file: lv.vtu, unit: mL/min/g, length_unit: cm, colour: red}"},
        "perfusion.colour = 'red': unknown field; known fields: file, array",
    ),
    "unknown field inside a list inside": (
        {"lumen": "{calcified: [{vessel: lca1, begin: 1, end: 2}]}"},
        "lumen.calcified.0.begin = 1: unknown field; known fields: vessel, start, end (also: lumen.calcified.0.start)",
    ),
    "unit": (
        {"perfusion": "{file: lv.vtu, array: MBF, unit: litres, length_unit: cm}"},
        "perfusion.unit = 'litres': input should be 'mL/s/g', 'mL/min/g'",
    ),
    "no anatomy": ({"anatomy": None}, "give anatomy, or network, or both"),
    "two anatomies": (
        {"anatomy": "{centrelines: tree.vtp, surface: lumen.stl}"},
        "anatomy: give exactly one of centrelines, surface, simvascular, mesh; given: centrelines, surface",
    ),
    "missing outlets": ({"outlets": None}, "outlets: required field is missing"),
    "file absent": ({"outlets": "nowhere.csv"}, "outlets = 'nowhere.csv': no such file; paths are relative"),
    "capitals": ({"targets": "Targets.csv"}, "targets = 'Targets.csv': no such file; did you mean targets.csv?"),
    "viscosity in Pa s": ({"viscosity": "0.0035"}, "; if 0.0035 is in Pa s, write 0.035"),
    "viscosity in cP": ({"viscosity": "4"}, "; if 4 is in cP or mPa s, write 0.04"),
    "period in ms": ({"period": "850"}, "; if 850 is in ms, write 0.85"),
    "heart rate": ({"period": "75"}, "; if 75 is a heart rate per min, write 0.8"),
    "density in SI": ({"density": "1060"}, "; if 1060 is in kg/m3, write 1.06"),
    "haematocrit in %": ({"haematocrit": "45"}, "; if 45 is in %, write 0.45"),
    "rise of flow": ({"hyperaemia": "4"}, "; if 4 is the factor by which flow rises, write 0.25"),
    "folder for a file": ({"targets": "."}, "is a folder; name a file"),
    "viscosity of SI": ({"viscosity": "0.0035"}, "viscosity = 0.0035: input should be greater than or equal to 0.005"),
    "not a number": ({"period": "fast"}, "period = 'fast': expected a number"),
    "number with a unit": ({"period": "0.8 s"}, "period = '0.8 s': expected a number; write 0.8 alone, in"),
    "number with a comma": ({"period": "0,8"}, "period = '0,8': expected a number; write 0.8, with a decimal point"),
    "a choice": ({"period": "yes"}, "period = 'yes': expected a number"),
    "nothing": ({"outlets": ""}, "outlets: is empty; give a value, or leave the field out"),
    "infinite": ({"density": ".inf"}, "density = inf: expected a finite number"),
    "stenosis twice": (
        {
            "stenoses": "[{name: LAD, vessel: lca1, start: 1, end: 2},"
            " {name: LAD, vessel: lca2, start: 1, end: 2}]"
        },
        "stenoses has LAD twice",
    ),
    "stenoses in a word": (
        {"stenoses": "none"},
        "stenoses = 'none': expected auto, a list such as [{name: LAD, vessel: LAD, start: 2.0, end: 3.0}], or []",
    ),
    "stenosis on no vessel": (
        {"stenoses": "[{name: LAD, vessel: lad9, start: 1, end: 2}]"},
        "stenoses.LAD.vessel = 'lad9': no such vessel; the tree has aorta, branch1, lca1",
    ),
    "stenosis beyond the end": (
        {"stenoses": "[{name: LAD, vessel: lca1, start: 1, end: 5}]"},
        "stenoses.LAD.end = 5.0: the vessel runs from 0 to 4 cm",
    ),
    "stenosis on the other artery": (
        {"stenoses": "[{name: LAD, vessel: lca2, start: 1, end: 2}]"},
        "stenoses.LAD.vessel = 'lca2': belongs to the LCx, not the LAD",
    ),
    "a bed of the aorta named as a coronary one": (
        {"systemic_outlets": "[{name: BC_lca1, vessel: aorta_outlet}]"},
        "systemic_outlets.name = 'BC_lca1': outlet lca1 has this name; give each its own",
    ),
    "stenosis name": (
        {"stenoses": "[{name: 2nd, vessel: branch1, start: 1.5, end: 2}]"},
        "stenoses.0.name = '2nd': expected a letter, then letters and digits; at most 16 characters",
    ),
    "stenosis half given": (
        {"stenoses": "[{name: LAD, vessel: lca1, start: 1}]"},
        "give start and end (cm along the vessel) with vessel",
    ),
    "map and flows": (
        {"territory_flows": "{file: flows.csv, unit: mL/s}"},
        "give perfusion (a map) or territory_flows (a table), exactly one",
    ),
    "wrong array": (
        {"perfusion": "{file: lv.vtu, array: flow, unit: mL/min/g, length_unit: cm}"},
        "perfusion.array = 'flow': no such array; the map has MBF",
    ),
    "wrong perfusion unit": (
        {"perfusion": "{file: lv.vtu, array: MBF, unit: mL/min/100g, length_unit: cm}"},
        "perfusion.unit = 'mL/min/100g': gives a median flow of 0.02 mL/min/g, outside 0.1 to 10.0; "
        "the values would be plausible in mL/min/g or mL/min/mL",
    ),
    "wrong length unit": (
        {"perfusion": "{file: lv.vtu, array: MBF, unit: mL/min/g, length_unit: mm}"},
        "perfusion.length_unit = 'mm': makes the wall 0.7 cm long; its points seem to be in cm",
    ),
    "map in another space": (
        {"perfusion": "{file: lv.vtu, array: MBF, unit: mL/min/g, length_unit: cm, "
                      "affine: [[1, 0, 0, 20], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}"},
        "from the outlets that perfuse it: map and anatomy are not aligned; check the affine",
    ),
    "affine to mm": (
        {"perfusion": "{file: lv.vtu, array: MBF, unit: mL/min/g, length_unit: cm, "
                      "affine: [[10, 0, 0, 0], [0, 10, 0, 0], [0, 0, 10, 0], [0, 0, 0, 1]]}"},
        "perfusion.affine: makes the wall 70 cm long; the affine must map to cm",
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_line_with_file_field_value_and_remedy(small_tree, tmp_path, mistake):
    changes, expected = MISTAKES[mistake]
    path = write_case(tmp_path, small_tree, **changes)
    findings, summary = check_case(path)
    assert len(findings) == 1 and not any(line.startswith("case ") for line in summary)
    assert "\n" not in findings[0] and findings[0].startswith(str(tmp_path))
    assert expected in findings[0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("name: [unclosed", "not valid YAML"),
        ("name: patient: 12\n", "line 1: not valid YAML (a colon in a text, or a wrong indentation? quote the text)"),
        ("lumen\n  voxel: 1\n", "line 1 = 'lumen': not valid YAML (is a colon missing after it?"),
        ("name: a\n---\nname: b\n", "line 2: not valid YAML (several documents; keep one)"),
        ("just text", "expected a mapping of fields"),
        ("name: a\nname: b\n", "name: given twice, in lines 1 and 2"),
        ("a: &x [1]\nb: *x\n", "aliases (*name) are not supported"),
        ("name: !!python/object/apply:os.system ['true']\n", "not valid YAML"),
        ("\x00", "not UTF-8 text"),
        ("name: a\nlumen:\n\tvoxel: 1\n", "case.yaml: line 3: has a tab; indent by blanks"),
    ],
)
def test_yaml_that_is_no_description_is_refused(tmp_path, text, expected):
    path = tmp_path / "case.yaml"
    path.write_text(text)
    findings, _ = check_case(path)
    assert len(findings) == 1 and expected in findings[0] and "\n" not in findings[0]


TABLES = {
    "unknown end": (
        "lca9,lca9,LV,LAD",
        "vessel of lca9 = 'lca9': not an end of the tree; its ends are lca1, lca2, rca1",
    ),
    "perfuses": ("lca1,lca1,left,LAD", "row 1, perfuses = 'left': allowed: LV, RV, septum"),
    "branch": ("lca1,lca1,LV,LM", "row 1, branch = 'LM': allowed: LAD, LCx, RCA"),
    "twice": ("lca1,lca1,LV,LAD\nlca1,lca2,LV,LCx", "name = 'lca1': duplicate"),
    "same end": ("a,lca1,LV,LAD\nb,lca1,LV,LCx", "b = 'lca1': another outlet is already at this end"),
    "none for the LV": ("lca1,lca1,RV,LAD", "no outlet perfuses the LV"),
    "name": ("-x,lca1,LV,LAD", "row 1, name = '-x': expected a letter"),
}


@pytest.mark.parametrize("mistake", TABLES)
def test_a_wrong_outlets_table_is_named_by_row_and_column(small_tree, tmp_path, mistake):
    rows, expected = TABLES[mistake]
    path = write_case(tmp_path, small_tree)
    (tmp_path / "outlets.csv").write_text("name,vessel,perfuses,branch\n" + rows + "\n")
    findings, _ = check_case(path)
    assert len(findings) == 1 and expected in findings[0] and "outlets.csv" in findings[0]


def test_ends_without_an_outlet_are_named_when_the_aortic_outlet_is_given(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree, systemic_outlets="[{name: BC_RCR1, vessel: aorta_outlet}]")
    (tmp_path / "outlets.csv").write_text("name,vessel,perfuses,branch\nlca1,lca1,LV,LAD\nrca1,rca1,LV,RCA\n")
    findings, _ = check_case(path)
    assert "vessel = 'lca2': these ends of the tree have no outlet" in findings[0]


def test_outlets_may_be_given_by_points_in_the_anatomys_unit(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree)
    ends = [small_tree[name].points[-1] for name in ("lca1", "lca2", "rca1")]
    (tmp_path / "outlets.csv").write_text(
        "name,x,y,z,perfuses,branch\n"
        + "".join(
            f"{name},{x + 0.05},{y},{z},LV,{branch}\n"
            for name, branch, (x, y, z) in zip("abc", ("LAD", "LCx", "RCA"), ends, strict=True)
        )
    )
    assert check_case(path)[0] == []
    far = (tmp_path / "outlets.csv").read_text().replace(f"{ends[0][0] + 0.05}", "9.0")
    (tmp_path / "outlets.csv").write_text(far)
    assert "the nearest end of the tree" in check_case(path)[0][0]


def test_words_and_units_may_be_spelt_in_any_usual_way(small_tree, tmp_path):
    path = write_case(
        tmp_path, small_tree, perfusion="{file: lv.vtu, array: MBF, unit: ml/g/min, length_unit: Centimeters}"
    )
    rows = "lca1,lca1,left ventricle,lad\nlca2,lca2,lv,Cx\nrca1,rca1,LV,rca\n"
    (tmp_path / "outlets.csv").write_text("name,vessel,perfuses,branch\n" + rows)
    (tmp_path / "targets.csv").write_text("name,value,unit\nPaoMean,90,mm Hg\nAbsQin,70,cc\n")
    findings, summary = check_case(path)
    assert findings == []
    text = "\n".join(summary)
    assert "(3 LV)" in text and "2.00 mL/min/g" in text and "targets: PaoMean 90 mmHg, AbsQin 70 mL" in text


@pytest.mark.parametrize("mark", ";\t")
def test_targets_without_a_heading_may_have_decimal_commas(small_tree, tmp_path, mark):
    path = write_case(tmp_path, small_tree)
    rows = [("PaoMean", "Mean, of cuff", "90,5"), ("AbsQin", "Stroke volume", "70")]
    (tmp_path / "targets.csv").write_text("".join(mark.join(row) + "\n" for row in rows))
    assert "targets: PaoMean 90.5 mmHg, AbsQin 70 mL" in check_case(path)[1]


def test_an_outlet_with_an_empty_territory_or_too_large_a_flow_is_noted(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree, perfusion=None, territory_flows="{file: flows.csv, unit: mL/min}")
    (tmp_path / "flows.csv").write_text("name,flow\nlca1,90\nlca2,60\nrca1,40\n")
    assert not [line for line in check_case(path)[1] if "outlet lca1" in line]
    (tmp_path / "flows.csv").write_text("name,flow\nlca1,900\nlca2,60\nrca1,40\n")
    radius = float(small_tree["lca1"].radii[-1])
    (told,) = (line for line in check_case(path)[1] if "outlet lca" in line)
    assert f"is a mean velocity of {15 / (np.pi * radius**2):.0f} cm/s; check flow, unit and calibre" in told


def test_an_outlet_far_from_the_wall_has_an_empty_territory(small_tree):
    feeding = [outlet(name, (x, 0.0, 0.0)) for name, x in (("near", 0.0), ("far", 9.0))]
    grid = pv.ImageData(dimensions=(3, 3, 3), spacing=(0.5,) * 3).cast_to_unstructured_grid()
    grid.cell_data["Volume"], grid.cell_data["MBF"] = np.full(8, 0.125), np.full(8, 2 / 60)
    (told,) = outlet_notes(Wall(grid, ()), feeding, 1.05)
    assert told.startswith("outlet far: its territory is empty")


def test_a_single_outlet_of_the_ventricle_is_noted_before_the_posterior_stops(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree, perfusion=None, territory_flows="{file: flows.csv, unit: mL/min}")
    rows = "name,vessel,perfuses,branch\nlca1,lca1,LV,LAD\nlca2,lca2,{},LCx\nrca1,rca1,RV,RCA\n"
    words = "outlet lca1 is the only one that perfuses the LV; the posterior"
    for tissue, flows, noted in (("septum", "lca1,90\n", True), ("LV", "lca1,90\nlca2,60\n", False)):
        (tmp_path / "outlets.csv").write_text(rows.format(tissue))
        (tmp_path / "flows.csv").write_text(f"name,flow\n{flows}")
        findings, lines = check_case(path)
        assert findings == [] and any(words in line for line in lines) == noted


def outlet(name, point):
    return CaseOutlet(
        name=name, label=name, bc=name, vessel=name, block=name, perfuses="LV", branch="LAD", point=point, radius=0.1
    )


def test_a_radius_that_no_coronary_artery_has_is_refused(small_tree, tmp_path):
    wide = replace(small_tree["lca1"], radii=np.where(np.arange(len(small_tree["lca1"].radii)) == 5, 3.0, 0.12))
    tree = Tree(wide if vessel.name == "lca1" else vessel for vessel in small_tree)
    assert "lca1 has a radius of 3 cm at" in check_case(write_case(tmp_path, tree))[0][0]


def test_an_outlet_at_the_end_of_the_aorta_is_refused(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree)
    with open(tmp_path / "outlets.csv", "a") as table:
        table.write("ao,aorta_outlet,RV,RCA\n")
    assert "outlets.csv: vessel of ao = 'aorta_outlet': is 24 mm wide, as an aorta" in check_case(path)[0][0]


def test_an_outlet_may_have_the_name_of_an_aortic_bed(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree)
    (tmp_path / "outlets.csv").write_text(
        "name,vessel,perfuses,branch\nRCR1,lca1,LV,LAD\nb,lca2,LV,LCx\nc,rca1,LV,RCA\n"
    )
    beds = assemble(path, Settings()).summary
    assert {o.bc for o in beds.outlets} == {"BC_RCR1", "BC_b", "BC_c"}
    assert "network: 9 vessels, 3 coronary outlets (3 LV), 1 systemic" in check_case(path)[1]


def test_an_artery_that_file_and_table_name_differently_is_noted(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree, stenoses="[]")
    (tmp_path / "outlets.csv").write_text(
        "name,vessel,perfuses,branch\nlca1,lca1,LV,LCx\nlca2,lca2,LV,LCx\nrca1,rca1,LV,RCA\n"
    )
    told = "note: outlet lca1: took branch LCx of the table; the anatomy's file says LAD"
    assert [line for line in check_case(path)[1] if "took branch" in line] == [told]


def test_a_misspelt_end_is_offered(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree)
    (tmp_path / "outlets.csv").write_text("name,vessel,perfuses,branch\na,LCA1,LV,LAD\n")
    assert "vessel of a = 'LCA1': not an end of the tree; did you mean lca1?" in check_case(path)[0][0]


@pytest.mark.parametrize(
    ("branches", "noted"),
    [("LAD LCx RCA", None), ("LAD LCx LAD", "lca1 and rca1"), ("LAD LCx LCx", "lca2 and rca1"), ("LAD LAD RCA", None)],
)
def test_a_branch_that_is_fed_from_two_ostia_is_noted(small_tree, tmp_path, branches, noted):
    path = write_case(tmp_path, small_tree, stenoses="[]")
    rows = [f"{v},{v},LV,{b}\n" for v, b in zip(("lca1", "lca2", "rca1"), branches.split(), strict=True)]
    (tmp_path / "outlets.csv").write_text("name,vessel,perfuses,branch\n" + "".join(rows))
    findings, summary = check_case(path)
    told = [line for line in summary if "ostia" in line]
    assert findings == [] and len(told) == (noted is not None)
    assert noted is None or f"are fed from 2 ostia ({noted}); check their branch" in told[0]


TARGETS = {
    "unknown": ("PaoMedian,x,90", "PaoMedian = 90.0: unknown target; did you mean PaoMean? known targets: PaoMin"),
    "not a number": ("PaoMean,x,ninety", "PaoMean = 'ninety': expected a number or none"),
    "twice": ("PaoMean,x,90\nPaoMean,x,91", "PaoMean = '91': duplicate"),
    "columns": ("PaoMean,90", "line 1 = 'PaoMean,90': expected name, description, value"),
    "decimal comma": ("PaoMean,x,93\nAbsQin,Stroke volume,71,5", "line 2 = 'AbsQin,Stroke volume,71,5': a decimal"),
    "thousands": ('AbsQin,x,"1,071"', "AbsQin = '1,071': expected a number or none, without separators of thousands"),
    "sign": ("PaoMin,x,-69", "PaoMin = -69.0: implausible: -69 mmHg, expected 25 to 200 mmHg"),
    "order": ("PaoMin,x,140\nPaoMax,x,120", "PaoMin = 140.0: must be below PaoMax, 120"),
    "per cent": (
        "PaoMean,x,93\nEFLV,x,61",
        "EFLV = 61.0: implausible: 61, expected 0.05 to 0.95; give a fraction, not per cent",
    ),
    "volume": ("AbsQin,x,-3", "AbsQin = -3.0: implausible: -3 mL, expected 5 to 300 mL"),
}


@pytest.mark.parametrize("mistake", TARGETS)
def test_a_wrong_target_is_reported(small_tree, tmp_path, mistake):
    text, expected = TARGETS[mistake]
    path = write_case(tmp_path, small_tree)
    (tmp_path / "targets.csv").write_text(text + "\n")
    assert expected in check_case(path)[0][0]


def test_implausible_targets_are_reported_in_one_unit(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree)
    (tmp_path / "targets.csv").write_text("PaoMean,x,123989.46\nPraMean,x,none\nEFLV,x,0.61\nAorCorSplit,x,4\n")
    assert "targets: PaoMean 93 mmHg, EFLV 0.61, AorCorSplit 4 %, AbsQin 83.33 mL" in check_case(path)[1]


def test_targets_come_in_any_unit_of_their_kind_from_either_format(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree)
    (tmp_path / "targets.csv").write_text("name,value,unit\nPaoMean,12.4,kPa\nEFLV,61,%\nAbsQin,0.07,L\n")
    assert "targets: PaoMean 93.01 mmHg, EFLV 0.61, AbsQin 70 mL" in check_case(path)[1]
    (tmp_path / "targets.csv").write_text("name,value,unit\nEFLV,61,mL\n")
    assert "EFLV.unit = 'mL': expected one of 1, %" in check_case(path)[0][0]


def test_the_examples_of_the_documentation_are_valid_and_its_fields_those_of_the_model(small_tree, tmp_path):
    docs = Path(__file__).parents[2] / "docs"
    listed = (docs / "reference" / "case.md").read_text(encoding="utf-8")
    assert listed[listed.index("### `case.yaml`") :] == f"{reference()}\n{names_reference()}", (
        "run tools/config_docs.py"
    )
    text = (docs / "how-to" / "your-patient.md").read_text(encoding="utf-8")
    blocks = [block for block in re.findall(r"(?:^    .*\n)+", text, re.MULTILINE) if block.startswith("    name: ")]
    assert len(blocks) == 3
    for block in blocks:
        (tmp_path / "case.yaml").write_text(textwrap.dedent(block))
        read_description(tmp_path / "case.yaml")
    for name, read in (("name,vessel,perfuses", read_outlets), ("PaoMin,", read_case_targets)):
        start = text.index(f"    {name}")
        (tmp_path / "table.csv").write_text(textwrap.dedent(text[start : text.index("\n\n", start)]))
        assert len(read(tmp_path / "table.csv")) > 3


def test_the_schema_describes_every_field():
    for name, field in schema()["properties"].items():
        assert field.get("description"), name


def test_the_description_of_the_small_case(small_tree, tmp_path):
    description = read_description(write_case(tmp_path, small_tree))
    assert description.anatomy.kind == "centrelines"
    assert (description.density, description.blood_viscosity, description.hyperaemia) == (1.06, 0.04, 0.24)


@pytest.mark.parametrize(
    ("fields", "viscosity"),
    [({}, 0.04), ({"haematocrit": "0.45"}, 0.0384), ({"haematocrit": "0.45", "viscosity": "0.035"}, 0.035)],
)
def test_viscosity_follows_from_the_haematocrit_unless_it_is_given(small_tree, tmp_path, fields, viscosity):
    case = assemble(write_case(tmp_path, small_tree, **fields), Settings())
    other = assemble(write_case(tmp_path / "default", small_tree), Settings())
    assert case.summary.viscosity == pytest.approx(viscosity, rel=1e-12)
    name = case.network.vessels[0]["vessel_name"]
    resistance, default = (each.network.vessel_values(name)["R_poiseuille"] for each in (case, other))
    assert resistance / default == pytest.approx(viscosity / 0.04, rel=1e-12)


def test_a_case_without_stenoses_says_what_that_leaves_out(small_tree, tmp_path):
    findings, summary = check_case(write_case(tmp_path, small_tree, stenoses="[]"))
    (told,) = [line for line in summary if line.startswith("stenoses: none, so no 3D runs")]
    proposed = re.search(r"such as stenoses: (\[.*\])$", told)[1]
    assert proposed == "[{name: RCA, vessel: rca1, start: 3.20, end: 4.20}]"
    assert check_case(write_case(tmp_path, small_tree, stenoses=proposed))[0] == []
    assert "name a stretch of an artery" in check_case(write_case(tmp_path, small_tree, stenoses="auto"))[0][0]


def test_a_wrong_length_unit_shows_in_the_arteries(small_tree, tmp_path):
    """The tree is in cm, its ends 1 to 1.2 mm in radius."""
    good = write_case(tmp_path / "cm", small_tree)
    assert "anatomy: 16 cm of coronary arteries, 2.0 to 4.0 mm in diameter" in check_case(good)[1]
    territories = {
        "perfusion": None,
        "territory_flows": "{file: flows.csv, unit: mL/min}",
        "anatomy": "{centrelines: tree.vtp, unit: m}",
        "stenoses": "[]",
    }
    path = write_case(tmp_path / "m", small_tree, **territories)
    (path.parent / "flows.csv").write_text("name,flow\nlca1,90\nlca2,90\nrca1,90\n")
    assert "anatomy.unit = 'm': gives the coronary ends a median radius of 12 cm" in check_case(path)[0][0]
    territories["anatomy"] = "{centrelines: tree.vtp, unit: mm}"
    path = write_case(tmp_path / "mm", small_tree, **territories)
    (path.parent / "flows.csv").write_text("name,flow\nlca1,90\nlca2,90\nrca1,90\n")
    note = "note: anatomy: in mm, the median radius of the coronary ends is 0.12 mm; check anatomy.unit"
    assert note in check_case(path)[1]
