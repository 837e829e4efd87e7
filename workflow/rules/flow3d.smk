# 3D: meshes and batches of samples. `mesh` and `run` are folders: the campaign's own (mesh, flow3d), the coarse level's
# (coarse), and on demand those of the mesh study (mesh_study/coarse, mesh_study/fine, mesh_study/half_step).


rule mesh:
    """Mesh the part of the anatomy that is simulated in 3D."""
    input:
        case=rules.case.output.case_json,
        tree=rules.case.output.tree_vtp,
        network=rules.case.output.network_json,
        files=files_under(given.lumen),
    output:
        archive=results("{mesh}", "mesh-complete.zip"),
        mesh_json=results("{mesh}", "mesh.json"),
        cost=cost_of("{mesh}", "mesh.json"),
    log:
        log_of("{mesh}", "mesh.log"),
    cache: cached
    params:
        **stage("coronaryuq.flow3d.mesh.stage:make_mesh", "coronaryuq.flow3d.mesh.generation.mmg_process"),
        settings=lambda wildcards: meshes[wildcards.mesh],
        lumen=given.lumen,
    script:
        "../scripts/stage.py"


rule mesh_folder:
    """Unpack the mesh into the folder that flow solvers read; only the archive can be cached."""
    input:
        archive=rules.mesh.output.archive,
    output:
        mesh_dir=directory(results("{mesh}", "mesh-complete")),
    log:
        log_of("{mesh}", "mesh_folder.log"),
    params:
        **stage("coronaryuq.flow3d.mesh.generation.folder:unpack"),
    script:
        "../scripts/stage.py"


rule flow3d_batch:
    """Run one batch of samples in 3D."""
    input:
        unpack(mesh_of),
        case_json=rules.case.output.case_json,
        network_json=rules.calibration.output.hyperaemia_json,
        draws_csv=rules.posterior.output.draws,
    output:
        records_jsonl=results("{run}", "batch_{k}.jsonl"),
        fields_zip=results("{run}", "fields_{k}.zip"),
        cost=cost_of("{run}", "batch_{k}.json"),
    log:
        log_of("{run}", "batch_{k}.log"),
    cache: cached
    resources:
        **({"mpi": "mpiexec", "tasks": 2} if campaign.backend in ("svsolver", "svmultiphysics") else {}),
    params:
        **stage("coronaryuq.campaign.jobs.flow3d:batch"),
        settings=lambda wildcards: runs_3d[wildcards.run].settings,
        posterior=block("posterior"),
        backend=campaign.backend,
        seed=campaign.seed,
        portion=lambda wildcards: runs_3d[wildcards.run].portions[int(wildcards.k)],
    script:
        "../scripts/stage.py"


rule mesh_study:
    """Compare the campaign's mesh with a coarser and a finer one, and its time step with half of it."""
    input:
        coarse=[results("mesh_study", "coarse", name) for name in ("mesh.json", "batch_0.jsonl")],
        campaign=[results("mesh", "mesh.json"), results("flow3d", "batch_0.jsonl")],
        fine=[results("mesh_study", "fine", name) for name in ("mesh.json", "batch_0.jsonl")],
        half_step=results("mesh_study", "half_step", "batch_0.jsonl"),
    output:
        out_json=results("mesh_study", "mesh_study.json"),
    log:
        log_of("mesh_study", "mesh_study.log"),
    params:
        **stage("coronaryuq.campaign.jobs.mesh_study:compare_meshes"),
    script:
        "../scripts/stage.py"
