"""The meshes and 3D runs of a campaign: its own, the coarse level's and those of the mesh study, by their folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coronaryuq.campaign.targets import Portions, Targets
from coronaryuq.config import Campaign

STUDY = {"mesh_study/coarse": 3 / 4, "mesh_study/fine": 4 / 3}
"""Resolution of the mesh study's other meshes divided by the campaign's."""
LONG_STEP = "mesh_study/long_step"
TEACHING = "losses"
"""Folder of the 3D runs that teach the 0D model its losses."""
STUDY_RUNS = 8
"""Samples at most that the mesh study runs on every level: as many as the ensemble solver advances together, which
costs as much as one."""
STUDY_COST = {"mesh_study/coarse": 0.5, "mesh_study/fine": 2.1, LONG_STEP: 0.5}
"""Cost of a run of the mesh study over that of the campaign, as nodes of the bundled patient's mesh times steps."""
STUDIES = (tuple(STUDY_COST), ("mesh_study/coarse", LONG_STEP), ("mesh_study/coarse",), ())
"""Levels of the mesh study, from the most accurate study to none."""
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
    own = own_settings(campaign)
    studied = {0: (0, min(STUDY_RUNS, campaign.samples.n_3d))}
    study = own | {"fields": 0, "max_cycles": own["min_cycles"]}
    return {
        "flow3d": Run3d("mesh", own, targets.batches),
        "coarse": Run3d("coarse", coarse_settings(campaign), targets.coarse_batches),
        **{folder: Run3d(folder, study, studied) for folder in STUDY},
        LONG_STEP: Run3d("mesh", longer_steps(study) | {"refinements": 0}, studied),
    }


def teaches(campaign: Campaign, in_3d: bool) -> bool:
    """Return whether 3D runs teach the 0D model its losses; in_3d: whether the case has a 3D model.

    A model on an UM-Bridge server has no vessels that could be changed, and reports no pressures at caps.
    """
    remote = "umbridge" in (campaign.backend, campaign.zerod.backend)
    return bool(campaign.losses.runs_3d) and in_3d and not remote


def loop_in_3d(campaign: Campaign, in_3d: bool) -> tuple[str, str]:
    """Return folder and file of the tuned loop that 3D runs are coupled to, in the results folder.

    With losses that 3D taught, or effects that were adopted, it is not the loop of 0D runs: inside the mesh its vessels
    have their own losses, and the lumen has what narrows it. in_3d: as of `teaches`.
    """
    if campaign.discrepancy.adopt:
        return "adopted", "hyperaemia_3d.json"
    if teaches(campaign, in_3d):
        return "losses", "hyperaemia_3d.json"
    return "calibration", "hyperaemia.json"


def teaching_settings(campaign: Campaign) -> dict[str, Any]:
    """Return the settings of the 3D runs that teach."""
    return own_settings(campaign) | {"fields": 0}


def study_levels(targets: Targets, lumen: str | None) -> tuple[str, ...]:
    """Return the folders of runs that the mesh study compares with the campaign's: as many as its cost allows.

    lumen: what the mesh is made from, if that is not the centrelines. An UM-Bridge server has one mesh and one time
    step, an imported mesh folder cannot be refined.
    """
    campaign = targets.campaign
    allowed = campaign.flow3d.mesh_study * targets.first_counts["n_3d"] or float("inf")
    possible = set() if campaign.backend == "umbridge" else set(STUDY_COST)
    if lumen is not None and Path(lumen).is_dir():
        possible -= set(STUDY)
    studies = [tuple(level for level in levels if level in possible) for levels in STUDIES]
    return next(levels for levels in studies if STUDY_RUNS * sum(STUDY_COST[level] for level in levels) <= allowed)


def assumes_mesh_error(campaign: Campaign, lumen: str | None) -> bool:
    """Return whether the error of the mesh is assumed where it was not measured; lumen: as of `study_levels`.

    The paper's setting has no numerical error, and of a mesh made elsewhere the resolution is not known.
    """
    made = campaign.backend != "umbridge" and not (lumen is not None and Path(lumen).is_dir())
    return campaign.uncertainty == "full" and made


def own_settings(campaign: Campaign) -> dict[str, Any]:
    """Return the settings of the campaign's own 3D runs."""
    return campaign.flow3d.model_dump(mode="json", exclude={"coarse", "mesh_study"})


def coarse_settings(campaign: Campaign) -> dict[str, Any]:
    """Return the settings of the coarse runs, for either solver, without fields."""
    coarse, settings = campaign.flow3d.coarse, own_settings(campaign)
    cycles = min(coarse.max_cycles, settings["max_cycles"])
    external = settings["simvascular"]
    return longer_steps(settings, coarse.steps) | {
        "max_cycles": cycles,
        "min_cycles": min(settings["min_cycles"], cycles),
        "fields": 0,
        "umbridge": settings["umbridge"] | {"model": "flow3d_coarse"},
        "simvascular": longer_steps(settings, coarse.steps)["simvascular"]
        | {"cycles": min(coarse.max_cycles, external["cycles"])},
    }


def longer_steps(settings: dict[str, Any], factor: float = 0.5) -> dict[str, Any]:
    """Return 3D settings with fewer time steps, for either solver; whole frames are kept."""
    external = settings["simvascular"]
    frames = external["frames_per_cycle"]
    steps = frames * max(1, round(factor * external["steps_per_cycle"] / frames))
    return settings | {
        "steps_per_cycle": max(100, round(factor * settings["steps_per_cycle"])),
        "simvascular": external | {"steps_per_cycle": steps},
    }
