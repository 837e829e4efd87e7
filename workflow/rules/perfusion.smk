# Territories and noise: blocks of noisy realisations, then their mean and covariance.


rule perfusion_chunk:
    input:
        case=rules.case.output.case,
        lv=rules.case.output.lv,
        code=code("coronaryuq.perfusion.stage"),
    output:
        chunk=results("perfusion", "chunk_{k}.npz"),
    log:
        log_of("perfusion", "chunk_{k}.log"),
    cache: True
    params:
        settings=block("perfusion", without=["realisations"]),
        seed=campaign.seed,
        portion=lambda wildcards: REALISATIONS[int(wildcards.k)],
    script:
        "../scripts/perfusion_chunk.py"


rule perfusion:
    input:
        case=rules.case.output.case,
        lv=rules.case.output.lv,
        chunks=expand(rules.perfusion_chunk.output.chunk, k=REALISATIONS),
        code=code("coronaryuq.perfusion.stage"),
    output:
        targets=results("perfusion", "targets.json"),
    log:
        log_of("perfusion", "gather.log"),
    params:
        settings=block("perfusion"),
    script:
        "../scripts/perfusion_gather.py"
