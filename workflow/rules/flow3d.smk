# 3D: the mesh, then one job per batch of pilot samples.


rule mesh:
    input:
        case=rules.case.output.case,
        tree=rules.case.output.tree,
        network=rules.case.output.network,
        code=code("coronaryuq.flow3d.mesh.stage", "coronaryuq.flow3d.mesh.worker"),
    output:
        archive=results("mesh", "mesh-complete.zip"),
        description=results("mesh", "mesh.json"),
    log:
        log_of("mesh.log"),
    cache: True
    params:
        settings=block("mesh"),
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
        settings=block("flow3d"),
        posterior=block("posterior"),
        backend=campaign.backend,
        seed=campaign.seed,
        portion=lambda wildcards: BATCHES[int(wildcards.k)],
    script:
        "../scripts/flow3d_batch.py"
