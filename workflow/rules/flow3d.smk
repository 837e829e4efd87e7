# 3D: meshes and batches of samples. `mesh` and `run` are folders: the campaign's own (mesh, flow3d), the coarse level's
# (coarse), and those of the mesh study (mesh_study/coarse, mesh_study/fine, mesh_study/long_step).


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


loop_in_3d = results(*variants.loop_in_3d(campaign, given.in_3d))


rule flow3d_batch:
    """Run one batch of samples in 3D."""
    input:
        unpack(mesh_of),
        case_json=rules.case.output.case_json,
        tree_vtp=rules.case.output.tree_vtp,
        network_json=loop_in_3d,
        draws_csv=draws(FIRST_CHAINS),
    output:
        records_jsonl=results("{run}", "batch_{k}.jsonl"),
        fields_zip=results("{run}", "fields_{k}.zip"),
        cost=cost_of("{run}", "batch_{k}.json"),
    log:
        log_of("{run}", "batch_{k}.log"),
    cache: cached
    resources:
        **({"mpi": LOCAL_MPIEXEC, "tasks": 2} if campaign.backend in ("svsolver", "svmultiphysics") else {}),
    params:
        **stage("coronaryuq.campaign.jobs.flow3d:batch"),
        settings=lambda wildcards: runs_3d[wildcards.run].settings,
        posterior=block("posterior"),
        backend=campaign.backend,
        seed=campaign.seed,
        portion=lambda wildcards: runs_3d[wildcards.run].portions[int(wildcards.k)],
    script:
        "../scripts/stage.py"


STUDIED = within(targets.batches, variants.STUDY_RUNS)


rule mesh_study:
    """Compare the campaign's runs with those on other meshes and with longer time steps."""
    input:
        own_mesh=results("mesh", "mesh.json"),
        own_runs=expand(results("flow3d", "batch_{k}.jsonl"), k=STUDIED),
        own_costs=expand(cost_of("flow3d/batch_{k}.json"), k=STUDIED),
        meshes=[results(level, "mesh.json") for level in study if level in meshes],
        runs=[results(level, "batch_0.jsonl") for level in study if level in meshes],
        long_step=[results(level, "batch_0.jsonl") for level in study if level not in meshes],
        costs=costs_of_study(),
    output:
        out_json=results("mesh_study", "mesh_study.json"),
    log:
        log_of("mesh_study", "mesh_study.log"),
    params:
        **stage("coronaryuq.campaign.jobs.mesh_study:compare_levels"),
        n_3d=campaign.samples.n_3d,
    script:
        "../scripts/stage.py"
