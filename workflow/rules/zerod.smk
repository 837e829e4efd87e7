# 0D: the same samples as 3D, the propagation sample, and the resampled inputs of each row, in chunks.


rule zerod_chunk:
    input:
        case=rules.case.output.case,
        network=rules.calibration.output.hyperaemia,
        draws=rules.posterior.output.draws,
        code=code("coronaryuq.zerod.stage", "coronaryuq.posterior.samples"),
    output:
        runs=results("zerod", "{set}_{k}.parquet"),
    log:
        log_of("zerod", "{set}_{k}.log"),
    cache: True
    params:
        settings=block("zerod"),
        posterior=block("posterior"),
        seed=campaign.seed,
        set=lambda wildcards: wildcards.set,
        portion=lambda wildcards: CHUNKS[wildcards.set][int(wildcards.k)],
    script:
        "../scripts/zerod_chunk.py"


rule pressure_map:
    input:
        network=rules.calibration.output.hyperaemia,
        case=rules.case.output.case,
        tree=rules.case.output.tree,
        draws=rules.posterior.output.draws,
        code=code("coronaryuq.zerod.pressure_map"),
    output:
        pressures=results("zerod", "pressures.csv"),
    log:
        log_of("zerod", "pressure_map.log"),
    script:
        "../scripts/pressure_map.py"
