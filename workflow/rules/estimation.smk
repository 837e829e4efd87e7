# Estimates: runs gathered in the published format, shared space trained, 0D rerun at the resampled inputs, the table.


checkpoint allocation:
    """Decide after one round of a growing campaign whether to stop, and which runs and chains the next round has."""
    input:
        unpack(runs_of_round),
        case=rules.case.output.case_json,
        pilot=results("samples", "pilot.csv"),
    output:
        round_json=results("allocation", "round_{r}.json"),
    log:
        log_of("allocation", "round_{r}.log"),
    wildcard_constraints:
        r=r"\d+",
    params:
        **stage("coronaryuq.campaign.jobs.allocation:allocate_round"),
        settings=block("estimation"),
        posterior=block("posterior"),
        seed=campaign.seed,
        number=lambda wildcards: int(wildcards.r),
        counts=targets.first_counts,
        runs_per_fine=targets.coarse_runs,
        portion={"n_3d": campaign.samples.batch_3d, "n_0d": campaign.samples.chunk_0d},
    script:
        "../scripts/stage.py"


rule runs:
    """Gather the campaign's runs in the format of the published runs."""
    input:
        unpack(runs_of_campaign),
        case=rules.case.output.case_json,
        pilot=results("samples", "pilot.csv"),
        propagation=results("samples", "propagation.csv"),
    output:
        **{name: results("runs", f"{name}.csv") for name in targets.coarse_tables},
        params=results("runs", "params.csv"),
        outputs_3d=results("runs", "outputs_3d.csv"),
        outputs_0d=results("runs", "outputs_0d.csv"),
        params_propagation=results("runs", "params_propagation.csv"),
        outputs_0d_propagation=results("runs", "outputs_0d_propagation.csv"),
        limits=results("runs", "param_limits.json"),
        rows=results("runs", "rows.csv"),
        failures=results("runs", "failures.json"),
        cost=cost_of("runs.json"),
    log:
        log_of("runs.log"),
    params:
        **stage("coronaryuq.campaign.jobs.runs:gather_runs"),
        settings=block("estimation"),
        posterior=block("posterior"),
        counts=targets.first_counts,
        runs_per_fine=targets.coarse_runs,
    script:
        "../scripts/stage.py"


RUNS = [path for name, path in rules.runs.output.items() if name != "cost"]


rule estimation_train:
    """Train the shared space of every row; write the 0D inputs that it requires."""
    input:
        runs=RUNS,
    output:
        networks_npz=results("estimation", "networks.npz"),
        resampled_csv=results("estimation", "resampled.csv"),
        cost=cost_of("estimation_train.json"),
    log:
        log_of("estimation", "train.log"),
    cache: cached
    params:
        **stage("coronaryuq.estimation.training:write_networks"),
        settings=block("estimation"),
        seed=campaign.seed,
    script:
        "../scripts/stage.py"


rule zerod_resampled:
    """Run one part of the resampled inputs through the 0D model."""
    input:
        case_json=rules.case.output.case_json,
        network_json=rules.calibration.output.hyperaemia_json,
        samples_csv=rules.estimation_train.output.resampled_csv,
    output:
        runs_parquet=results("zerod", "resampled_{k}.parquet"),
        cost=cost_of("zerod", "resampled_{k}.json"),
    log:
        log_of("zerod", "resampled_{k}.log"),
    cache: cached
    params:
        **stage("coronaryuq.campaign.jobs.zerod:resampled"),
        settings=block("zerod"),
        # The number of runs is known only after training; every job takes an equal part.
        share=lambda wildcards: int(wildcards.k),
        shares=len(targets.shares),
    script:
        "../scripts/stage.py"


rule estimation:
    """Estimate every row with every estimator."""
    input:
        **({"mesh_study": rules.mesh_study.output.out_json} if campaign.flow3d.mesh_study else {}),
        **({"assumed_on": results("mesh", "mesh.json")} if assumes_mesh_error else {}),
        runs=RUNS,
        networks_npz=rules.estimation_train.output.networks_npz,
        zerod_tables=expand(rules.zerod_resampled.output.runs_parquet, k=targets.shares),
    output:
        estimates_json=results("estimation", "estimates.json"),
        table_csv=report(results("estimation", "table.csv"), caption="../report/table.rst", category="Estimates"),
        cost=cost_of("estimation.json"),
    log:
        log_of("estimation", "estimates.log"),
    params:
        **stage("coronaryuq.estimation.stage:estimate"),
        settings=block("estimation"),
        seed=campaign.seed,
    script:
        "../scripts/stage.py"


rule pairs:
    """Write the pairs of 3D and 0D outputs, at the same and at the resampled inputs."""
    input:
        runs=RUNS,
        networks_npz=rules.estimation_train.output.networks_npz,
        zerod_tables=expand(rules.zerod_resampled.output.runs_parquet, k=targets.shares),
    output:
        out_csv=results("estimation", "pairs.csv"),
    log:
        log_of("estimation", "pairs.log"),
    params:
        **stage("coronaryuq.estimation.analysis.pairs_table:write_pairs"),
        settings=block("estimation"),
        seed=campaign.seed,
    script:
        "../scripts/stage.py"


rule convergence:
    """Compute the convergence of the estimators with the number of 3D runs."""
    input:
        runs=RUNS,
    output:
        out_json=results("estimation", "convergence.json"),
    log:
        log_of("estimation", "convergence.log"),
    params:
        **stage("coronaryuq.estimation.stage:convergence"),
        settings=block("estimation"),
        seed=campaign.seed,
    script:
        "../scripts/stage.py"


rule budget:
    """Compute the gain by further 3D and 0D runs."""
    input:
        estimates_json=rules.estimation.output.estimates_json,
        failures_json=rules.runs.output.failures,
    output:
        out_json=results("estimation", "budget.json"),
    log:
        log_of("estimation", "budget.log"),
    params:
        **stage("coronaryuq.estimation.analysis.budget:write_budget"),
        settings=block("estimation"),
    script:
        "../scripts/stage.py"


rule tuning:
    """Search hyper-parameters of the autoencoders by their held-out loss."""
    input:
        runs=RUNS,
        rows_csv=rules.runs.output.rows,
    output:
        out_json=results("estimation", "tuning.json"),
    log:
        log_of("estimation", "tuning.log"),
    params:
        **stage("coronaryuq.estimation.analysis.tuning:tune"),
        settings=block("estimation"),
        seed=campaign.seed,
    script:
        "../scripts/stage.py"
