# 3D: the mesh, then one job per batch of pilot samples.


rule mesh:
    input:
        case=rules.case.output.case,
        tree=rules.case.output.tree,
        network=rules.case.output.network,
        lumen=files_under(LUMEN) if LUMEN else [],
        code=code("coronaryuq.flow3d.mesh.stage", "coronaryuq.flow3d.mesh.generation.mmg_process"),
    output:
        archive=results("mesh", "mesh-complete.zip"),
        description=results("mesh", "mesh.json"),
    log:
        log_of("mesh.log"),
    cache: True
    params:
        settings=block("mesh"),
        lumen=LUMEN,
    script:
        "../scripts/mesh.py"


rule mesh_folder:
    # The archive is one file, which a cache can hold; the folder is what the flow solvers read.
    input:
        archive=rules.mesh.output.archive,
    output:
        folder=directory(results("mesh", "mesh-complete")),
    log:
        log_of("mesh_folder.log"),
    script:
        "../scripts/mesh_folder.py"


rule flow3d_batch:
    input:
        case=rules.case.output.case,
        network=rules.calibration.output.hyperaemia,
        mesh_folder=rules.mesh_folder.output.folder,
        mesh=rules.mesh.output.description,
        draws=rules.posterior.output.draws,
        code=code("coronaryuq.flow3d.stage", "coronaryuq.posterior.samples"),
    output:
        records=results("flow3d", "batch_{k}.jsonl"),
        fields=results("flow3d", "fields_{k}.zip"),
    log:
        log_of("flow3d", "batch_{k}.log"),
    cache: True
    resources:
        **({} if campaign.backend == "ensemble" else {"mpi": "mpiexec", "tasks": 2}),
    params:
        settings=block("flow3d", without=["coarse"]),
        posterior=block("posterior"),
        backend=campaign.backend,
        seed=campaign.seed,
        portion=lambda wildcards: BATCHES[int(wildcards.k)],
    script:
        "../scripts/flow3d_batch.py"


def mesh_settings(factor):
    """The campaign's mesh settings with every resolution times a factor, as far down as settings may go."""
    settings = block("mesh")
    for name in ("throat_resolution", "resolution", "jet_resolution", "core_resolution"):
        least = 2.0 if name == "throat_resolution" else 1.5 if settings[name] else 0.0
        settings[name] = max(least, settings[name] * factor)
    return settings


# The coarse level, where one is asked for: a model between 3D and 0D, for the estimates.


def coarse_settings():
    """Settings of the coarse runs, of either solver, without fields."""
    settings = block("flow3d", without=["coarse"])
    cycles = min(COARSE.max_cycles, settings["max_cycles"])
    external = settings["simvascular"]
    frames = external["frames_per_cycle"]
    return settings | {
        "steps_per_cycle": max(100, round(COARSE.steps * settings["steps_per_cycle"])),
        "max_cycles": cycles,
        "min_cycles": min(settings["min_cycles"], cycles),
        "fields": 0,
        "simvascular": external
        | {
            "steps_per_cycle": frames * max(1, round(COARSE.steps * external["steps_per_cycle"] / frames)),
            "cycles": min(COARSE.max_cycles, external["cycles"]),
        },
    }


use rule mesh as coarse_mesh with:
    output:
        archive=results("coarse", "mesh-complete.zip"),
        description=results("coarse", "mesh.json"),
    log:
        log_of("coarse", "mesh.log"),
    params:
        settings=mesh_settings(COARSE.resolution),
        lumen=LUMEN,


use rule mesh_folder as coarse_mesh_folder with:
    input:
        archive=rules.coarse_mesh.output.archive,
    output:
        folder=directory(results("coarse", "mesh-complete")),
    log:
        log_of("coarse", "mesh_folder.log"),


use rule flow3d_batch as coarse_batch with:
    input:
        case=rules.case.output.case,
        network=rules.calibration.output.hyperaemia,
        mesh_folder=rules.coarse_mesh_folder.output.folder,
        mesh=rules.coarse_mesh.output.description,
        draws=rules.posterior.output.draws,
        code=code("coronaryuq.flow3d.stage", "coronaryuq.posterior.samples"),
    output:
        records=results("coarse", "batch_{k}.jsonl"),
        fields=results("coarse", "fields_{k}.zip"),
    log:
        log_of("coarse", "batch_{k}.log"),
    params:
        settings=coarse_settings(),
        posterior=block("posterior"),
        backend=campaign.backend,
        seed=campaign.seed,
        portion=lambda wildcards: COARSE_BATCHES[int(wildcards.k)],


# How far from converged mesh and time step are: the first samples again on a coarser and a finer mesh, and with half the
# step. On demand, as it costs about three blocks of samples on the finer mesh.

STUDY = {"coarse": 3 / 4, "fine": 4 / 3}
STUDIED = (0, min(8, campaign.samples.n_3d, campaign.samples.batch_3d))


use rule mesh as study_mesh with:
    output:
        archive=results("mesh_study", "{level}", "mesh-complete.zip"),
        description=results("mesh_study", "{level}", "mesh.json"),
    log:
        log_of("mesh_study", "{level}_mesh.log"),
    params:
        settings=lambda wildcards: mesh_settings(STUDY[wildcards.level]),
        lumen=LUMEN,


use rule mesh_folder as study_mesh_folder with:
    input:
        archive=rules.study_mesh.output.archive,
    output:
        folder=directory(results("mesh_study", "{level}", "mesh-complete")),
    log:
        log_of("mesh_study", "{level}_mesh_folder.log"),


use rule flow3d_batch as study_batch with:
    input:
        case=rules.case.output.case,
        network=rules.calibration.output.hyperaemia,
        mesh_folder=rules.study_mesh_folder.output.folder,
        mesh=rules.study_mesh.output.description,
        draws=rules.posterior.output.draws,
        code=code("coronaryuq.flow3d.stage", "coronaryuq.posterior.samples"),
    output:
        records=results("mesh_study", "{level}", "batch.jsonl"),
        fields=results("mesh_study", "{level}", "fields.zip"),
    log:
        log_of("mesh_study", "{level}_batch.log"),
    params:
        settings=block("flow3d", without=["coarse"]),
        posterior=block("posterior"),
        backend=campaign.backend,
        seed=campaign.seed,
        portion=STUDIED,


def halved_step(wildcards):
    """The campaign's 3D settings with twice the steps."""
    settings = block("flow3d", without=["coarse"])
    settings["steps_per_cycle"] *= 2
    settings["simvascular"]["steps_per_cycle"] *= 2
    return settings


use rule flow3d_batch as study_step with:
    output:
        records=results("mesh_study", "halved_step.jsonl"),
        fields=results("mesh_study", "halved_step_fields.zip"),
    log:
        log_of("mesh_study", "halved_step.log"),
    params:
        settings=halved_step,
        posterior=block("posterior"),
        backend=campaign.backend,
        seed=campaign.seed,
        portion=STUDIED,


rule mesh_study:
    input:
        coarse=[results("mesh_study", "coarse", "mesh.json"), results("mesh_study", "coarse", "batch.jsonl")],
        campaign=[rules.mesh.output.description, results("flow3d", "batch_0.jsonl")],
        fine=[results("mesh_study", "fine", "mesh.json"), results("mesh_study", "fine", "batch.jsonl")],
        halved_step=rules.study_step.output.records,
        code=code("coronaryuq.flow3d.mesh_study"),
    output:
        study=results("mesh_study", "mesh_study.json"),
    log:
        log_of("mesh_study", "mesh_study.log"),
    script:
        "../scripts/mesh_study.py"
