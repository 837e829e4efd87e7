"""`coronaryuq init` writes a case that `check` reads, with blanks only for what nobody can guess."""

import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.case.anatomy.tree import Tree, Vessel, write_tree
from coronaryuq.case.draft.write import LITERATURE, targets_table
from coronaryuq.case.tables.read import read_case_targets
from coronaryuq.case.tables.targets import BY_NAME
from coronaryuq.cli.check import check
from coronaryuq.cli.main import main
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from support.case_files import small_tree, straight, write_case
from support.small_loop import loop
from support.sv_project import write_vessel
from support.tubes import tube_surface

SHARED = (
    "cases/no-aorta/lumen.stl",
    "cases/two-trees",
    "cases/same-name",
    "cases/numeric-vessel-names/P",
    "cases/mac-shadow-files/P",
    "cases/no-stroke-volume",
    "cases/image-position/no-position/tree.vtp",
    "data/coro0d-p1",
)
"""Anatomies that can be read without a choice."""


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def init(path, *more: str) -> int:
    return main(["init", str(path), "--into", "mine", *more])


def fault() -> str:
    error = check("mine/case.yaml").error
    return "" if error is None else str(error)


def fill_flows(flow: str = "40") -> None:
    path = Path("mine/flows.csv")
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *(f"{row.split(',')[0]},{flow}" for row in rows)]) + "\n")


def scaled(tree: Tree, factor: float) -> Tree:
    return Tree(Vessel(v.name, v.points * factor, v.radii * factor, v.parent, v.branch) for v in tree)


def short_tree() -> Tree:
    """An aorta just wide enough to be one, with three short arteries."""
    vessels = (
        ("aorta", (0, 0, 0), (0, 0, 1), 1.0, (0.7, 0.7)),
        ("branch1", (0, 0, 1), (1, 0, 0), 1.6, (0.2, 0.2), "aorta", "LM"),
        ("lca1", (1.6, 0, 1), (1, 0, -1), 1.5, (0.16, 0.14), "branch1", "LAD"),
        ("lca2", (1.6, 0, 1), (1, 1, 0), 1.0, (0.15, 0.14), "branch1", "LCx"),
        ("rca1", (0, 0, 1), (-1, 0, 0), 2.0, (0.18, 0.15), "aorta", "RCA"),
        ("aorta_outlet", (0, 0, 1), (0, 0, 1), 1.5, (0.7, 0.7), "aorta"),
    )
    return Tree([straight(*vessel) for vessel in vessels])


def write_lumen(path: Path, tree: Tree, factor: float) -> None:
    import pyvista as pv

    points, triangles = tube_surface(tree, 0.05)
    pv.PolyData.from_regular_faces(points * factor, triangles).save(path)


@pytest.mark.parametrize("source", SHARED)
def test_of_every_readable_anatomy_only_the_flows_are_asked_for(shared, here, source):
    path = shared / source
    if not path.exists():
        pytest.skip(f"needs ../shared/{source}")
    assert init(path, "--yes") == 0
    assert "flows.csv: flow: not given for " in fault() and "\n" not in fault()
    fill_flows()
    assert fault() == ""


def test_with_a_map_nothing_is_left_to_ask(here, capsys):
    write_case(here / "given", small_tree())
    assert init("given/tree.vtp", "--perfusion", "given/lv.vtu", "--targets", "given/targets.csv", "--yes") == 0
    assert "outlet lca1: LAD, LV" in capsys.readouterr().out
    found = check("mine/case.yaml")
    assert found.error is None and found.case is not None
    assert found.case.description.perfusion.unit == "mL/min/g"
    assert {o.name: o.branch for o in found.case.summary.outlets} == {"lca1": "LAD", "lca2": "LCx", "rca1": "RCA"}
    assert sorted(path.name for path in Path("mine").iterdir()) == [
        "README.md", "campaign.yaml", "case.yaml", "outlets.csv"
    ]  # fmt: skip


def test_the_commented_place_of_a_wire_is_sound(here):
    write_tree("tree.vtp", small_tree())
    assert init("tree.vtp", "--yes") == 0
    fill_flows("10")
    case = Path("mine/case.yaml")
    assert case.read_text().count("# ffr_at: [{artery: LAD, distance: ") == 1
    assert fault() == ""
    case.write_text(case.read_text().replace("# ffr_at", "ffr_at"))
    assert fault() == ""
    (place,) = check(case).case.summary.ffr_at
    assert (place.artery, place.measured, place.sd) == ("LAD", 0.84, 0.02)


def test_the_configuration_is_sound_once_the_flows_are_given(here, monkeypatch):
    write_tree("tree.vtp", small_tree())
    assert init("tree.vtp", "--yes") == 0
    fill_flows()
    monkeypatch.chdir("mine")
    found = check("campaign.yaml")
    assert found.error is None and found.kind == "configuration"
    assert found.campaign.samples.n_3d == 104 and found.campaign.case == "case.yaml"
    commands = [line.strip() for line in Path("README.md").read_text().splitlines() if "    coronaryuq" in line]
    assert commands[0] == "coronaryuq check case.yaml" and commands[-1].startswith("coronaryuq run campaign.yaml")


@pytest.mark.parametrize(("unit", "factor"), [("cm", 1.0), ("mm", 10.0), ("m", 0.01)])
def test_the_unit_is_the_one_that_makes_sense(here, unit, factor):
    write_tree("tree.vtp", scaled(small_tree(), factor))
    assert init("tree.vtp", "--yes") == 0
    assert f"tree.vtp, unit: {unit}" in Path("mine/case.yaml").read_text()


@pytest.mark.slow
def test_a_surface_gets_a_row_for_every_coronary_cap_and_none_for_the_aorta(here):
    tree, factor = short_tree(), 10.0
    write_lumen(here / "lumen.stl", tree, factor)
    assert init("lumen.stl", "--yes") == 0
    assert "lumen.stl, unit: mm, inlet: [" in Path("mine/case.yaml").read_text()
    rows = [line.split(",") for line in Path("mine/outlets.csv").read_text().splitlines()]
    assert rows[0][:4] == ["name", "x", "y", "z"] and len(rows) == 4
    ends = [tree[name].points[-1] * factor for name in ("lca1", "lca2", "rca1")]
    placed = np.array([[float(cell) for cell in row[1:4]] for row in rows[1:]])
    assert all(np.linalg.norm(placed - end, axis=1).min() < 0.05 * factor for end in ends)
    fill_flows()
    assert fault() == ""


def test_a_project_and_a_table_of_points_are_read_by_name(here):
    for name, start, end, radius in (
        ("aorta", (0, 0, 0), (0, 0, 6), 1.2),
        ("LAD", (0, 0, 2), (5, 0, 2), 0.15),
        ("D1", (3, 0, 2), (3, 2, 2), 0.1),
        ("RCA", (0, 0, 2), (-6, 0, 2), 0.15),
    ):
        write_vessel(here / "project", name, start, end, radius)
    assert init("project", "--yes") == 0
    table = Path("mine/outlets.csv").read_text()
    assert "\nLAD,LV,LAD" in table and "\nD1,LV,LAD" in table and "\nRCA,LV,RCA" in table and "aorta" not in table
    lines = ["name,x,y,z,radius"]
    for vessel in small_tree():
        lines += [f"{vessel.name},{x},{y},{z},{r}" for (x, y, z), r in zip(vessel.points, vessel.radii, strict=True)]
    Path("tree.csv").write_text("\n".join(lines) + "\n")
    assert main(["init", "tree.csv", "--yes"]) == 0
    assert "lca1" in Path("tree-case/outlets.csv").read_text()


def test_of_a_network_the_arteries_that_no_name_tells_are_asked_for_in_one_line(here):
    write_json("loop.json", loop())
    assert init("loop.json", "--yes") == 0
    assert "outlets.csv: " in fault() and "not given; fill in " in fault() and "\n" not in fault()
    found = check("mine/case.yaml")
    names = [line.split(",")[0] for line in Path("mine/outlets.csv").read_text().splitlines()[1:]]
    (asked,) = [line for line in found.lines if "what are they?" in line]
    assert all(f"{name} (vessel " in asked for name in names) and found.sketch.tree is not None


def test_beds_of_a_network_whose_names_differ_by_their_prefix_have_rows_of_their_own(here):
    text = Path("loop.json")
    write_json(text, loop())
    text.write_text(text.read_text().replace("BC_lca1", "BC_LAD").replace("BC_lca2", "LAD"))
    assert init("loop.json", "--yes") == 0
    rows = [line.split(",") for line in Path("mine/outlets.csv").read_text().splitlines()]
    names = [dict(zip(rows[0], row, strict=True)) for row in rows[1:]]
    assert [(row["name"], row["bc"]) for row in names] == [("LAD", "BC_LAD"), ("LAD_2", "LAD")]


def test_nothing_is_overwritten_and_the_line_names_the_file(here, capsys):
    write_tree("tree.vtp", small_tree())
    Path("mine").mkdir()
    Path("mine/outlets.csv").write_text("mine\n")
    assert init("tree.vtp", "--yes") == InputError.EXIT_CODE
    line = capsys.readouterr().err
    assert "mine/outlets.csv: is there already and is not overwritten" in line and line.count("\n") == 1
    assert [path.name for path in Path("mine").iterdir()] == ["outlets.csv"]
    assert Path("mine/outlets.csv").read_text() == "mine\n"
    assert sorted(path.name for path in here.iterdir()) == ["mine", "tree.vtp"]


@pytest.mark.parametrize(
    ("content", "name", "line"),
    [
        (None, "gone.vtp", "gone.vtp: no such file or folder; expected a SimVascular project"),
        ("text", "tree.doc", "tree.doc = '.doc': unknown file type"),
        ("name,x,y,z\n", "tree.csv", "tree.csv: radius: column missing"),
        ("{}", "loop.json", "loop.json: "),
        ("[1, 2]", "loop.json", "loop.json: vessels: missing; expected a closed-loop network"),
        ("null", "loop.json", "loop.json: vessels: missing; expected a closed-loop network"),
    ],
)
def test_a_fault_is_one_line_and_leaves_nothing(here, capsys, content, name, line):
    if content is not None:
        Path(name).write_text(content)
    assert init(name, "--yes") == InputError.EXIT_CODE
    printed = capsys.readouterr().err
    assert line in printed
    assert printed.count("\n") == 1 and not Path("mine").exists()


def test_points_without_a_surface_are_refused_and_groups_where_there_are_none(here, capsys):
    pv.PolyData(np.eye(3)).save("points.vtp")
    assert init("points.vtp", "--yes") == InputError.EXIT_CODE
    assert "points.vtp: triangles = 0: contains points or lines alone" in capsys.readouterr().err
    assert init("points.vtp", "--yes", "--group", "LAD") == InputError.EXIT_CODE
    assert "--group = 'LAD': only a SimVascular project has groups" in capsys.readouterr().err


def test_a_folder_around_the_vessels_is_refused_with_their_name(here, shared, capsys):
    folder = Path("scan")
    folder.mkdir()
    for name in ("lumen.stl", "flows.csv", "._lumen.stl"):
        (folder / name).write_text("")
    shutil.copytree(shared / "cases/same-name", folder / "P")
    assert init("scan", "--yes") == InputError.EXIT_CODE
    printed = capsys.readouterr().err
    assert printed.rstrip().endswith("give what in this folder has the vessels: P, lumen.stl")
    assert printed.count("\n") == 1 and not Path("mine").exists()


def test_on_a_terminal_unit_aorta_and_stenoses_are_asked(here, monkeypatch, capsys):
    narrow = small_tree(lca1=101)
    vessel = narrow["lca1"]
    bump = 1.0 - 0.6 * np.exp(-(((vessel.arc - 2.0) / 0.3) ** 2))
    narrow = narrow.with_vessels({"lca1": Vessel("lca1", vessel.points, vessel.radii * bump, vessel.parent, "LAD")})
    write_tree("tree.vtp", narrow)
    answers = iter(["feet", "", "9", "", "n"])
    asked: list[str] = []

    def answer(question: str) -> str:
        asked.append(question)
        return next(answers)

    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("builtins.input", answer)
    assert init("tree.vtp") == 0
    printed = capsys.readouterr().out
    assert "one of cm, mm, m, please" in printed and "numbers from 1 to 4, please" in printed
    assert "Length unit" in asked[0] and "the aorta's" in asked[2] and "Is it a stenosis?" in asked[4]
    assert "stenoses: []" in Path("mine/case.yaml").read_text()
    assert main(["init", "tree.vtp", "--yes"]) == 0 and len(asked) == 5
    assert "{name: LAD, vessel: lca1" in Path("tree-case/case.yaml").read_text()


def test_two_contour_groups_of_a_path_are_chosen_by_an_option(shared, here, capsys):
    project = shared / "cases" / "two-groups-of-one-path" / "P"
    if not project.is_dir():
        pytest.skip("needs ../shared/cases")
    assert init(project, "--yes") == InputError.EXIT_CODE
    assert "name the one to use by --group" in capsys.readouterr().err
    assert init(project, "--yes", "--group", "LAD_final") == 0
    fill_flows()
    assert fault() == "" and "groups: [LAD_final]" in Path("mine/case.yaml").read_text()


def test_targets_are_blank_or_marked_as_literature(here):
    Path("targets.csv").write_text(targets_table())
    targets = read_case_targets(Path("targets.csv"))
    assert {name for name, target in targets.items() if target.value is not None} == set(LITERATURE)
    assert not any(BY_NAME[name].clinical for name in LITERATURE)
    assert all("literature" in targets[name].description for name in LITERATURE)


def test_names_with_blanks_and_numbers_survive(here):
    tree = Tree(
        Vessel(*values)
        for values in (
            ("1", np.array([[0, 0, 0], [1, 0, 0.0]]), np.array([0.2, 0.2])),
            ("no: 2 {", np.array([[1, 0, 0], [4, 0, 0.0]]), np.array([0.15, 0.1]), "1"),
            ("true", np.array([[1, 0, 0], [1, 4, 0.0]]), np.array([0.15, 0.1]), "1"),
        )
    )
    folder = Path("a folder: {x}")
    folder.mkdir()
    write_tree(folder / "tree.vtp", tree)
    assert init(folder / "tree.vtp", "--yes") == 0
    fill_flows()
    assert fault() == ""
    assert json.dumps("../a folder: {x}/tree.vtp") in Path("mine/case.yaml").read_text()


def waisted(vessel: Vessel, middle: float) -> Vessel:
    """Return a vessel with a narrowing of 84 % of the area in its middle."""
    arc = np.linspace(0.0, vessel.length, 101)
    points = vessel.points[0] + (arc / vessel.length)[:, None] * (vessel.points[-1] - vessel.points[0])
    radii = vessel.radius_at(arc) * (1.0 - 0.6 * np.exp(-(((arc - middle) / 0.3) ** 2)))
    return Vessel(vessel.name, points, radii, vessel.parent, vessel.branch)


def test_a_stenosis_in_a_side_branch_is_not_called_that_of_the_artery(here, capsys):
    tree = small_tree()
    start = tree["lca1"].points[-1]
    side = straight("diag", start, (0, 0.8, -0.6), 4.0, (0.11, 0.11), "lca1", "LAD")
    end = straight("lad", start, (0.6, 0, -0.8), 6.0, (0.11, 0.11), "lca1", "LAD")
    write_tree("tree.vtp", Tree([*tree, waisted(side, 2.0), waisted(end, 3.0)]))
    assert init("tree.vtp", "--yes") == 0
    told = [line for line in capsys.readouterr().out.splitlines() if line.startswith("stenosis ")]
    assert any(line.startswith("stenosis LAD: vessel lad, ") and "of the area; check it" in line for line in told)
    assert any(line.startswith("stenosis diag: vessel diag, ") for line in told) and len(told) == 2
    page = Path("mine/README.md").read_text()
    assert "delete those that are no stenosis" in page and "- diag: vessel diag, " in page
    fill_flows()
    assert fault() == ""
    assert any(line.startswith("stenosis LAD: vessel lad = LAD, ") for line in check("mine/case.yaml").lines)
    case = Path("mine/case.yaml")
    case.write_text(re.sub(r"^stenoses:\n(  - .*\n)+", "stenoses: auto\n", case.read_text(), flags=re.MULTILINE))
    found = [line for line in check(case).lines if line.startswith("note: stenosis ") and "found on" in line]
    assert [line.split(":")[1].split()[-1] for line in found] == ["diag", "LAD"]


def test_the_next_command_can_be_pasted(here, capsys):
    write_tree("tree.vtp", small_tree())
    assert main(["init", "tree.vtp", "--into", "my patients/no 1", "--yes"]) == 0
    words = shlex.split(capsys.readouterr().out.splitlines()[-1].split(", then ")[1])
    assert words == ["coronaryuq", "check", "my patients/no 1/case.yaml"]


def test_without_a_stenosis_every_command_of_the_page_stops_at_the_posterior(here):
    write_tree("tree.vtp", small_tree())
    assert init("tree.vtp", "--yes") == 0
    page = Path("mine/README.md").read_text()
    runs = [line for line in page.splitlines() if line.startswith("    coronaryuq run")]
    assert len(runs) == 2 and all("campaign.yaml posterior" in line for line in runs)
    assert "no narrowing was found" in page


def test_a_dry_run_says_that_it_has_not_read_the_blank_tables(here, monkeypatch, capfd):
    write_tree("tree.vtp", small_tree())
    assert init("tree.vtp", "--yes") == 0
    monkeypatch.chdir("mine")
    assert main(["run", "campaign.yaml", "posterior", "--dry-run"]) == 0
    assert "tables and vessels were not read. coronaryuq check campaign.yaml reads them." in capfd.readouterr().err
    assert main(["check", "campaign.yaml"]) == InputError.EXIT_CODE
