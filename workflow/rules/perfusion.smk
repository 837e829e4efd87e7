# Territories and noise: portions of noisy realisations, then their mean and covariance.


rule perfusion_chunk:
    """Simulate one portion of the noisy realisations of territories and flows."""
    input:
        case_json=rules.case.output.case_json,
        lv_vtu=rules.case.output.lv_vtu,
        tree_vtp=rules.case.output.tree_vtp,
    output:
        out_npz=results("perfusion", "chunk_{k}.npz"),
        cost=cost_of("perfusion_chunk_{k}.json"),
    log:
        log_of("perfusion", "chunk_{k}.log"),
    cache: cached
    params:
        **stage("coronaryuq.perfusion.stage:run_chunk"),
        settings=block("perfusion", without=["realisations"]),
        seed=campaign.seed,
        first=lambda wildcards: targets.realisations[int(wildcards.k)][0],
        number=lambda wildcards: targets.realisations[int(wildcards.k)][1],
    script:
        "../scripts/stage.py"


rule perfusion:
    """Gather the realisations to target flows and their covariance."""
    input:
        case_json=rules.case.output.case_json,
        lv_vtu=rules.case.output.lv_vtu,
        tree_vtp=rules.case.output.tree_vtp,
        chunks=expand(rules.perfusion_chunk.output.out_npz, k=targets.realisations),
    output:
        out_json=results("perfusion", "targets.json"),
        cost=cost_of("perfusion.json"),
    log:
        log_of("perfusion", "gather.log"),
    params:
        **stage("coronaryuq.perfusion.stage:gather"),
        settings=block("perfusion"),
    script:
        "../scripts/stage.py"
