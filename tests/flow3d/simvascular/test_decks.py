"""Decks for svSolver and svMultiPhysics against the formats that they read, without the programs."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.case.anatomy.tree import read_tree
from coronaryuq.case.network.build import Physics
from coronaryuq.case.network.network import NARROWED, UNCERTAIN
from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.adapter import Sample
from coronaryuq.flow3d.narrowed_network import Place, content
from coronaryuq.flow3d.simvascular import coupled_case, svsolver
from coronaryuq.flow3d.simvascular.svmultiphysics import SvMultiPhysics
from coronaryuq.flow3d.simvascular.svsolver import SvSolver
from coronaryuq.zerod.effect_mixture import EffectMixture, Member
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.network.read import check_network, read_network
from support.sv_case import make_case

pytestmark = pytest.mark.slow

SAMPLE = Sample("s7", 6, {"BC_LAD": 1.3, "R_cor_scaling": 0.9})


@pytest.fixture(scope="session")
def case(tmp_path_factory):
    return make_case(tmp_path_factory.mktemp("case"))


@pytest.fixture(scope="session")
def run(case, tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "s7"
    SvSolver(case).prepare(SAMPLE, folder)
    return folder


@pytest.fixture(scope="session")
def xml(case, tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "s7"
    SvMultiPhysics(case).prepare(SAMPLE, folder)
    return folder, ElementTree.parse(folder / "solver.xml").getroot()


def test_coupled_network_has_a_flow_block_for_every_cap_and_this_samples_resistances(case, run):
    network = read_network(run / coupled_case.NETWORK)
    check_network(network)
    blocks = {block["name"]: block for block in network["external_solver_coupling_blocks"]}
    assert set(blocks) == {"inlet_LAD", "outlet_LAD"}
    assert blocks["inlet_LAD"]["location"] == "outlet"
    assert blocks["outlet_LAD"] | {} == {
        "name": "outlet_LAD", "type": "FLOW", "location": "inlet", "connected_block": "LAD", "periodic": False,
        "values": {"t": [0.0, 1.0], "Q": [1.0, 1.0]},
    }  # fmt: skip
    simulation = network["simulation_parameters"]
    assert simulation["coupled_simulation"] and simulation["output_all_cycles"] and not simulation["steady_initial"]
    assert simulation["absolute_tolerance"] >= 1e-6, "below rounding at pressures of 1e5 dyn/cm2"
    given = next(b for b in case.network["boundary_conditions"] if b["bc_name"] == "BC_LAD")["bc_values"]
    here = next(b for b in network["boundary_conditions"] if b["bc_name"] == "BC_LAD")["bc_values"]
    for name in ("Ra", "Ram", "Rv"):
        assert here[name] == pytest.approx(1.3 * 0.9 * given[name])
    for name in ("Ca", "Cim"):
        assert here[name] == given[name]


def test_coupled_network_starts_from_the_samples_periodic_state(case, run):
    network = json.loads((run / coupled_case.NETWORK).read_text())
    start = network["initial_condition"]
    assert set(start) == set(Model(network).variables)
    assert start["flow:LAD_seg0:inlet_LAD"] == pytest.approx(start["flow:outlet_LAD:LAD"], rel=0.05, abs=0.05)
    assert 30.0 < start["pressure:LAD_seg0:inlet_LAD"] / 1333.22 < 140.0
    assert start["pressure:LAD_seg0:inlet_LAD"] != start["pressure:outlet_LAD:LAD"]
    assert start["V_LV:CLH"] > 0.0


def test_initial_field_is_the_mean_cap_pressure(case, run):
    field = pv.read(run / coupled_case.INITIAL)
    start = json.loads((run / coupled_case.NETWORK).read_text())["initial_condition"]
    mean = 0.5 * (start["pressure:LAD_seg0:inlet_LAD"] + start["pressure:outlet_LAD:LAD"])
    for name in ("pressure", "Pressure"):
        np.testing.assert_allclose(field.point_data[name], mean)
    assert not field.point_data["velocity"].any()


def test_the_preprocessor_script_uses_known_commands_and_existing_files(run):
    known = {
        "mesh_and_adjncy_vtu", "set_surface_id_vtp", "fluid_density", "fluid_viscosity", "read_pressure_velocity_vtu",
        "pressure_vtp", "noslip_vtp", "write_numstart", "write_geombc", "write_restart",
    }  # fmt: skip
    ids = {}
    for line in (run / svsolver.PREPROCESSOR).read_text().splitlines():
        command, *arguments = line.split()
        assert command in known
        if arguments[0].endswith((".vtp", ".vtu")):
            assert (run / arguments[0]).is_file()
        if command == "set_surface_id_vtp":
            ids[arguments[0].rsplit("/", 1)[1]] = int(arguments[1])
    assert ids == {"mesh-complete.exterior.vtp": 1, "inlet_LAD.vtp": 2, "outlet_LAD.vtp": 3}
    assert command == "write_restart"


def test_solver_inp_has_the_settings_of_the_case(case, run):
    entries = dict(line.split(": ", 1) for line in (run / svsolver.DECK).read_text().splitlines())
    assert entries["Number of Neumann Surfaces"] == entries["Number of Coupled Surfaces"] == "2"
    assert entries["List of Neumann Surfaces"] == "2 3"
    assert entries["Pressure Coupling"] == "P-Implicit"
    assert entries["Use svZeroD for Boundary Conditions"] == "True"
    assert float(entries["Residual Tolerance"]) == 1e12
    assert float(entries["Time Step Size"]) * int(entries["Number of Timesteps"]) == pytest.approx(
        case.period * case.settings.cycles
    )
    assert case.settings.steps_per_cycle % int(entries["Number of Timesteps between Restarts"]) == 0


def test_the_interface_file_has_the_layout_that_svsolver_reads(case, run):
    """Header, value, blank line; in this order and to the last blank line."""
    lines = (run / svsolver.INTERFACE).read_text().split("\n")
    items, at = [], 0
    for count in (1, 1, 2, 1, 1, 1, 1):
        assert lines[at].strip()
        items.append(lines[at + 1 : at + 1 + count])
        assert lines[at + 1 + count] == ""
        at += count + 2
    assert items[0] == [case.settings.zerod_library]
    assert items[1] == [str(run / coupled_case.NETWORK)]
    assert [line.split() for line in items[2]] == [["inlet_LAD", "2"], ["outlet_LAD", "3"]]
    assert items[3] == items[5] == ["0"]
    assert (run / svsolver.INTERFACE).read_text().endswith("0.0\n\n")


def test_solver_xml_couples_every_cap(case, xml):
    folder, root = xml
    general = root.find("GeneralSimulationParameters")
    assert float(general.findtext("Time_step_size")) == pytest.approx(case.time_step)
    assert int(general.findtext("Number_of_time_steps")) == case.steps
    mesh = root.find("Add_mesh")
    assert (folder / mesh.findtext("Mesh_file_path").strip()).is_file()
    faces = {face.get("name"): face.findtext("Face_file_path").strip() for face in mesh.findall("Add_face")}
    assert set(faces) == {"wall", "inlet_LAD", "outlet_LAD"}
    assert all((folder / path).is_file() for path in faces.values())
    assert (folder / mesh.findtext("Initial_pressures_file_path").strip()).is_file()
    equation = root.find("Add_equation")
    assert equation.get("type") == "fluid"
    interface = equation.find("svZeroDSolver_interface")
    assert interface.findtext("Coupling_type").strip() == "semi-implicit"
    assert (folder / interface.findtext("Configuration_file").strip()).is_file()
    # Left out, so that the library starts from the JSON's own state.
    assert interface.find("Initial_flows") is None and interface.find("Initial_pressures") is None
    conditions = {bc.get("name"): bc for bc in equation.findall("Add_BC")}
    assert set(conditions) == set(faces)
    for name in ("inlet_LAD", "outlet_LAD"):
        assert conditions[name].findtext("Type").strip() == "Neu"
        assert conditions[name].findtext("Time_dependence").strip() == "Coupled"
        assert conditions[name].find("Coupling_interface").findtext("svZeroDSolver_block").strip() == name
    assert conditions["wall"].findtext("Type").strip() == "Dir"


def test_programs_are_launched_under_mpi(case):
    pre, solve, post = SvSolver(case, tasks=96).commands()
    assert pre == ["svpre", "case.svpre"]
    assert solve == ["mpiexec", "-n", "96", "svsolver", "solver.inp"]
    assert post[post.index("-indir") + 1] == "96-procs_case"
    assert SvMultiPhysics(case, tasks=4).commands() == [["mpiexec", "-n", "4", "svmultiphysics", "solver.xml"]]


def test_a_path_too_long_for_fortran_is_rejected(case, tmp_path):
    far = replace(case, settings=case.settings.model_copy(update={"zerod_library": "/" + "x" * 200}))
    with pytest.raises(InputError, match="160 characters"):
        SvSolver(far).prepare(SAMPLE, tmp_path / "run")


def test_what_an_uncertain_parameter_changes_beside_the_mesh_reaches_the_0d_side(case):
    """Of a vessel that the mesh cuts, the part that stays changes in proportion; the part inside changes nothing."""
    own = Model(case.network).parameters
    changes = {name: np.array([own[name] * 1.7]) for name in ("LAD.R_poiseuille", "CLH.Rrv_a", "BC_RCR.Rp")}
    full = dict.fromkeys(case.engine.state_names, 0.0)
    before, after = (coupled_case.coupled_json(case, given, full) for given in ({}, changes))
    for network, factor in ((before, 1.0), (after, 1.7)):
        here = Model(network).parameters
        for name in ("CLH.Rrv_a", "BC_RCR.Rp"):
            assert here[name] == pytest.approx(factor * own[name])
        part = Model(before).parameters["LAD.R_poiseuille"]
        assert 0 < part < own["LAD.R_poiseuille"] and here["LAD.R_poiseuille"] == pytest.approx(factor * part)
    inside = {"LAD_seg1.R_poiseuille": np.ones(1)} if "LAD_seg1" in case.domain.description.replaces else {}
    assert inside and coupled_case.coupled_json(case, inside, full) == before


@pytest.fixture(scope="session")
def narrowed(case):
    """The case with an adopted narrowing of the vessel behind its stenosis, which the mesh cuts."""
    scales = {"pressure": 1.2e5, "period": 1.0, "flow": {"LAD": 2.0}}
    effects = ("quadratic_stenosis", "diffuse_narrowing")
    members = tuple(Member(name, "LAD", 0.5, False, (-1.0,), ((0.04,),), {}) for name in effects)
    network = case.network.deep_copy()
    network[UNCERTAIN] = [EffectMixture("missing_1", members, scales).content()]
    tree = read_tree(case.mesh_folder.parents[1] / "tree.vtp")
    (kept,) = (piece["LAD"] for piece in case.domain.description.pieces)
    place = Place.of(tree["LAD"], 1.9, 3.0, kept)
    network[NARROWED] = content({("missing_1", 0): place, ("missing_1", 1): place}, Physics())
    return replace(case, network=network, tree=tree)


def test_a_sample_with_a_narrowing_gets_a_mesh_of_its_own_and_the_0d_part_its_share(narrowed, tmp_path):
    sample = Sample("s1", 0, {"BC_LAD": 1.0, "missing_1_size": 0.5, "missing_1_member": 1.0})
    drawn = narrowed.drawn(sample, tmp_path / "mesh")
    read = pv.read(tmp_path / "mesh" / "mesh-complete.mesh.vtu")
    np.testing.assert_allclose(read.points, drawn.domain.points, atol=1e-6)
    moved = np.linalg.norm(drawn.domain.points - narrowed.domain.points, axis=1)
    assert moved.max() > 1e-3
    assert moved[narrowed.domain.points[:, 1] < 1.9 - 0.15].max() < 0.01 * moved.max()
    before, after = beside(narrowed), beside(drawn)
    assert after["LAD.R_poiseuille"] > 1.01 * before["LAD.R_poiseuille"] and after["LAD.L"] > before["LAD.L"]
    assert {name for name in before if before[name] != after[name]} == {"LAD.R_poiseuille", "LAD.L"}


def test_the_run_starts_from_the_loop_with_the_narrowing(narrowed, tmp_path):
    pressure = []
    for size in (-30.0, 2.0):
        sample = Sample("s2", 0, {"BC_LAD": 1.0, "missing_1_size": size, "missing_1_member": 1.0})
        case = narrowed.drawn(sample, tmp_path / "mesh")
        coupled_case.begin(case, sample, tmp_path / "run")
        start = json.loads((tmp_path / "run" / coupled_case.NETWORK).read_text())["initial_condition"]
        pressure.append(start["pressure:LAD:BC_LAD"])
    assert pressure[1] < 0.99 * pressure[0]


def beside(case):
    full = dict.fromkeys(case.engine.state_names, 0.0)
    return Model(coupled_case.coupled_json(case, {}, full)).parameters
