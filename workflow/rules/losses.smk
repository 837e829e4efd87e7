# Pressure losses of the 0D vessels, learnt from a few 3D runs before the loop is tuned for all others.


# Tune the loop to which the 3D runs that teach are coupled.
use rule calibration as losses_calibration with:
    input:
        case_json=rules.case.output.case_json,
        network_json=rules.case.output.network_json,
        targets_json=rules.perfusion.output.out_json,
    output:
        rest_json=results("losses", "calibration", "rest.json"),
        hyperaemia_json=results("losses", "calibration", "hyperaemia.json"),
        parameters_csv=results("losses", "calibration", "parameters.csv"),
        fit_csv=results("losses", "calibration", "fit.csv"),
        cost=cost_of("losses", "calibration.json"),
    log:
        log_of("losses", "calibration.log"),


rule losses_inputs:
    """Choose the inputs of the 3D runs that teach."""
    input:
        case_json=rules.case.output.case_json,
        hyperaemia_json=rules.losses_calibration.output.hyperaemia_json,
        targets_json=rules.perfusion.output.out_json,
    output:
        samples_csv=results("losses", "inputs.csv"),
    log:
        log_of("losses", "inputs.log"),
    params:
        **stage("coronaryuq.losses.inputs:teaching_inputs"),
        settings=block("posterior"),
        seed=campaign.seed,
        number=campaign.losses.runs_3d,
    script:
        "../scripts/stage.py"


rule losses_runs:
    """Run them in 3D."""
    input:
        case_json=rules.case.output.case_json,
        tree_vtp=rules.case.output.tree_vtp,
        network_json=rules.losses_calibration.output.hyperaemia_json,
        mesh_dir=results("mesh", "mesh-complete"),
        mesh_json=results("mesh", "mesh.json"),
        samples_csv=rules.losses_inputs.output.samples_csv,
    output:
        records_jsonl=results("losses", "runs.jsonl"),
        cost=cost_of("losses", "runs.json"),
    log:
        log_of("losses", "runs.log"),
    cache: cached
    resources:
        **({"mpi": LOCAL_MPIEXEC, "tasks": 2} if campaign.backend in ("svsolver", "svmultiphysics") else {}),
    params:
        **stage("coronaryuq.campaign.jobs.flow3d:teaching_batch"),
        settings=variants.teaching_settings(campaign),
        backend=campaign.backend,
        number=campaign.losses.runs_3d,
    script:
        "../scripts/stage.py"


rule losses:
    """Learn the losses from these runs, and write the network with them."""
    input:
        case_json=rules.case.output.case_json,
        case_network_json=rules.case.output.network_json,
        hyperaemia_json=rules.losses_calibration.output.hyperaemia_json,
        mesh_json=results("mesh", "mesh.json"),
        records_jsonl=rules.losses_runs.output.records_jsonl,
    output:
        network_json=results("losses", "network.json"),
        losses_csv=results("losses", "losses.csv"),
        fit_json=results("losses", "fit.json"),
        cost=cost_of("losses", "fit.json"),
    log:
        log_of("losses", "fit.log"),
    params:
        **stage("coronaryuq.losses.stage:learn_losses"),
    script:
        "../scripts/stage.py"


rule losses_in_3d:
    """Give the tuned loop's vessels their own losses for 3D runs, which have those of the flow itself."""
    input:
        hyperaemia_json=rules.calibration.output.hyperaemia_json,
        fit_json=rules.losses.output.fit_json,
    output:
        out_json=results("losses", "hyperaemia_3d.json"),
    log:
        log_of("losses", "in_3d.log"),
    params:
        **stage("coronaryuq.losses.own_losses:for_3d"),
    script:
        "../scripts/stage.py"
