# 0D: the same samples as 3D, the propagation sample, and the resampled inputs of each row, in chunks.


rule zerod_chunk:
    """Run one portion of a table of inputs through the 0D model."""
    input:
        case_json=rules.case.output.case_json,
        network_json=rules.calibration.output.hyperaemia_json,
        draws_csv=lambda wildcards: draws(lengths_of_chunk(wildcards)),
    output:
        runs_parquet=results("zerod", "{set}_{k}.parquet"),
        cost=cost_of("zerod", "{set}_{k}.json"),
    log:
        log_of("zerod", "{set}_{k}.log"),
    cache: cached
    params:
        **stage("coronaryuq.campaign.jobs.zerod:chunk"),
        settings=block("zerod"),
        posterior=block("posterior"),
        seed=campaign.seed,
        name=lambda wildcards: wildcards.set,
        portion=lambda wildcards: targets.chunks[wildcards.set][int(wildcards.k)],
        lengths=lambda wildcards: lengths_of_chunk(wildcards),
    script:
        "../scripts/stage.py"


rule pressure_map:
    """Compute mean pressure and flow along the tree, lowest FFR and pressure drops, over the posterior."""
    input:
        network_json=rules.calibration.output.hyperaemia_json,
        case_json=rules.case.output.case_json,
        tree_vtp=rules.case.output.tree_vtp,
        draws_csv=lambda wildcards: draws(lengths_of_campaign()),
    output:
        out_csv=report(results("zerod", "pressures.csv"), caption="../report/pressures.rst", category="Flow"),
        predicted_csv=report(results("zerod", "predicted.csv"), caption="../report/predicted.rst", category="Summary"),
    log:
        log_of("zerod", "pressure_map.log"),
    params:
        **stage("coronaryuq.campaign.jobs.zerod:pressures"),
        posterior=block("posterior"),
        seed=campaign.seed,
        lengths=lambda wildcards: lengths_of_campaign(),
    script:
        "../scripts/stage.py"
