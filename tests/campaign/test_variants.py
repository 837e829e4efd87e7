"""The meshes and 3D runs of a campaign."""

import pytest

from coronaryuq.campaign import variants
from coronaryuq.campaign.targets import Targets
from coronaryuq.config import Campaign
from coronaryuq.flow3d.mesh.settings import Settings as MeshSettings
from coronaryuq.flow3d.settings import Settings


def campaign(**blocks):
    return Campaign(name="x", **blocks)


def test_settings_of_every_mesh_and_run_are_valid():
    given = campaign(flow3d={"coarse": {"runs_per_fine": 4}})
    for settings in variants.meshes(given).values():
        MeshSettings(**settings)
    for run in variants.runs_3d(Targets(given)).values():
        Settings(**run.settings)
        assert run.mesh in variants.meshes(given)


def test_the_campaigns_own_mesh_is_as_configured():
    given = campaign(mesh={"resolution": 2.3})
    assert variants.meshes(given)["mesh"] == given.mesh.model_dump(mode="json")


def test_resolutions_scale_down_to_their_least_value_and_stay_off():
    given = campaign(mesh={"throat_resolution": 2.0, "resolution": 4.0, "core_resolution": 0})
    coarse = variants.meshes(given)["mesh_study/coarse"]
    assert (coarse["throat_resolution"], coarse["resolution"], coarse["core_resolution"]) == (2.0, 3.0, 0.0)


def test_longer_steps_are_half_the_steps_of_either_solver():
    runs = variants.runs_3d(Targets(campaign()))
    own, longer = runs["flow3d"].settings, runs["mesh_study/long_step"].settings
    assert longer["steps_per_cycle"] == own["steps_per_cycle"] / 2
    assert longer["simvascular"]["steps_per_cycle"] == own["simvascular"]["steps_per_cycle"] / 2
    assert longer["refinements"] == 0, "a sample that blew up would be run with the campaign's step again"


def test_runs_of_the_mesh_study_have_the_fewest_cycles():
    given = campaign(flow3d={"min_cycles": 3, "max_cycles": 5})
    runs = variants.runs_3d(Targets(given))
    for level in variants.STUDY_COST:
        assert runs[level].settings["min_cycles"] == runs[level].settings["max_cycles"] == 3
        assert runs[level].portions == {0: (0, variants.STUDY_RUNS)}


@pytest.mark.parametrize(
    ("n_3d", "levels"),
    [
        (104, ("mesh_study/coarse", "mesh_study/fine", "mesh_study/long_step")),
        (40, ("mesh_study/coarse", "mesh_study/long_step")),
        (16, ("mesh_study/coarse",)),
        (8, ()),
    ],
)
def test_the_mesh_study_does_what_a_quarter_of_the_3d_runs_pays_for(n_3d, levels):
    found = variants.study_levels(Targets(campaign(samples={"n_3d": n_3d})), None)
    assert found == levels
    assert variants.STUDY_RUNS * sum(variants.STUDY_COST[level] for level in found) <= 0.25 * n_3d


def test_a_mesh_study_that_is_asked_for_as_a_target_is_whole():
    off = campaign(samples={"n_3d": 8}, flow3d={"mesh_study": 0})
    assert variants.study_levels(Targets(off), None) == tuple(variants.STUDY_COST)


def test_what_cannot_be_refined_is_not_run_again(tmp_path):
    given = Targets(campaign(samples={"n_3d": 104}))
    assert variants.study_levels(given, str(tmp_path)) == ("mesh_study/long_step",), "an imported mesh folder"
    assert len(variants.study_levels(given, str(tmp_path / "lumen.stl"))) == 3
    assert variants.study_levels(Targets(campaign(backend="umbridge")), None) == ()


def test_the_mesh_error_is_assumed_where_all_is_uncertain_and_the_mesh_is_ours(tmp_path):
    assert variants.assumes_mesh_error(campaign(uncertainty="full"), None)
    assert variants.assumes_mesh_error(campaign(uncertainty="full"), str(tmp_path / "lumen.stl"))
    assert not variants.assumes_mesh_error(campaign(uncertainty="full"), str(tmp_path)), "an imported mesh folder"
    assert not variants.assumes_mesh_error(campaign(uncertainty="full", backend="umbridge"), None)
    assert not variants.assumes_mesh_error(campaign(uncertainty="paper"), None)


def test_the_cost_of_the_mesh_study_makes_no_3d_run_stale():
    few, many = (variants.runs_3d(Targets(campaign(flow3d={"mesh_study": share}))) for share in (0.1, 0.9))
    assert few == many


def test_coarse_runs_keep_whole_frames_and_no_fields():
    settings = variants.coarse_settings(campaign(flow3d={"fields": 2}))
    assert settings["fields"] == 0
    assert settings["simvascular"]["steps_per_cycle"] % settings["simvascular"]["frames_per_cycle"] == 0


@pytest.mark.parametrize(
    ("settings", "in_3d", "expected"),
    [
        ({}, True, True),
        ({}, False, False),
        ({"losses": {"runs_3d": 0}}, True, False),
        ({"backend": "umbridge"}, True, False),
        ({"zerod": {"backend": "umbridge"}}, True, False),
        ({"backend": "svsolver"}, True, True),
    ],
)
def test_3d_teaches_0d_where_both_models_are_here(settings, in_3d, expected):
    assert variants.teaches(Campaign(name="x", **settings), in_3d) is expected


@pytest.mark.parametrize(
    ("blocks", "in_3d", "folder"),
    [
        ({}, True, "losses"),
        ({}, False, "calibration"),
        ({"losses": {"runs_3d": 0}}, True, "calibration"),
        ({"discrepancy": {"adopt": True}}, True, "adopted"),
        ({"discrepancy": {"adopt": True}, "losses": {"runs_3d": 0}}, True, "adopted"),
    ],
)
def test_3d_runs_have_the_loop_whose_vessels_inside_the_mesh_are_their_own(blocks, in_3d, folder):
    assert variants.loop_in_3d(campaign(**blocks), in_3d)[0] == folder
