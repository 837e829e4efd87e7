"""The meshes and 3D runs of a campaign: its own, the coarse level's and those of the mesh study, by their folder."""

from dataclasses import dataclass
from typing import Any

from coronaryuq.campaign.targets import Portions, Targets
from coronaryuq.config import Campaign

STUDY = {"mesh_study/coarse": 3 / 4, "mesh_study/fine": 4 / 3}
"""Resolution of the mesh study's other meshes divided by the campaign's."""
STUDY_RUNS = 8
"""Maximum number of samples that the mesh study runs on every mesh."""
RESOLUTIONS = {"throat_resolution": 2.0, "resolution": 1.5, "jet_resolution": 1.5, "core_resolution": 1.5}
"""Settings that are scaled for a coarser or finer mesh, and their smallest value (a setting of 0 is off and stays
off)."""


@dataclass(frozen=True)
class Run3d:
    """One kind of 3D runs. mesh: its folder; settings: block `flow3d` for these runs; portions: its batches."""

    mesh: str
    settings: dict[str, Any]
    portions: Portions


def meshes(campaign: Campaign) -> dict[str, dict[str, Any]]:
    """Return the mesh settings of every folder of a mesh."""
    scales = {"mesh": 1.0, "coarse": campaign.flow3d.coarse.resolution, **STUDY}
    return {folder: scaled(campaign, scale) for folder, scale in scales.items()}


def scaled(campaign: Campaign, scale: float) -> dict[str, Any]:
    """Return the campaign's mesh settings with every resolution times `scale`, clipped at the smallest allowed."""
    settings = campaign.mesh.model_dump(mode="json")
    if scale != 1.0:
        for name, least in RESOLUTIONS.items():
            off = name != "throat_resolution" and not settings[name]
            settings[name] = max(0.0 if off else least, settings[name] * scale)
    return settings


def runs_3d(targets: Targets) -> dict[str, Run3d]:
    """Return every kind of 3D runs, by the folder of its records."""
    campaign = targets.campaign
    own = campaign.flow3d.model_dump(mode="json", exclude={"coarse"})
    studied = {0: (0, min(STUDY_RUNS, campaign.samples.n_3d, campaign.samples.batch_3d))}
    return {
        "flow3d": Run3d("mesh", own, targets.batches),
        "coarse": Run3d("coarse", coarse_settings(campaign), targets.coarse_batches),
        **{folder: Run3d(folder, own, studied) for folder in STUDY},
        "mesh_study/half_step": Run3d("mesh", half_step_settings(own), studied),
    }


def coarse_settings(campaign: Campaign) -> dict[str, Any]:
    """Return the settings of the coarse runs, for either solver, without fields."""
    coarse, settings = campaign.flow3d.coarse, campaign.flow3d.model_dump(mode="json", exclude={"coarse"})
    cycles = min(coarse.max_cycles, settings["max_cycles"])
    external = settings["simvascular"]
    frames = external["frames_per_cycle"]
    steps = frames * max(1, round(coarse.steps * external["steps_per_cycle"] / frames))
    return settings | {
        "steps_per_cycle": max(100, round(coarse.steps * settings["steps_per_cycle"])),
        "max_cycles": cycles,
        "min_cycles": min(settings["min_cycles"], cycles),
        "fields": 0,
        "umbridge": settings["umbridge"] | {"model": "flow3d_coarse"},
        "simvascular": external | {"steps_per_cycle": steps, "cycles": min(coarse.max_cycles, external["cycles"])},
    }


def half_step_settings(settings: dict[str, Any]) -> dict[str, Any]:
    """Return 3D settings with twice the time steps, for either solver."""
    external = settings["simvascular"]
    return settings | {
        "steps_per_cycle": 2 * settings["steps_per_cycle"],
        "simvascular": external | {"steps_per_cycle": 2 * external["steps_per_cycle"]},
    }
