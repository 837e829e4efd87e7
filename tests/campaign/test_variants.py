"""The meshes and 3D runs of a campaign."""

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


def test_half_the_step_is_twice_the_steps_of_either_solver():
    runs = variants.runs_3d(Targets(campaign()))
    own, half = runs["flow3d"].settings, runs["mesh_study/half_step"].settings
    assert half["steps_per_cycle"] == 2 * own["steps_per_cycle"]
    assert half["simvascular"]["steps_per_cycle"] == 2 * own["simvascular"]["steps_per_cycle"]


def test_coarse_runs_keep_whole_frames_and_no_fields():
    settings = variants.coarse_settings(campaign(flow3d={"fields": 2}))
    assert settings["fields"] == 0
    assert settings["simvascular"]["steps_per_cycle"] % settings["simvascular"]["frames_per_cycle"] == 0
