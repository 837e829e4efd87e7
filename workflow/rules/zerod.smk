# 0D: the same samples as 3D, the propagation sample, and the resampled inputs of each row, in chunks.


rule zerod_chunk:
    input:
        case=rules.case.output.case,
        network=rules.calibration.output.hyperaemia,
        samples=results("samples", "{set}_{k}.csv"),
        code=code("coronaryuq.zerod.stage"),
    output:
        runs=results("zerod", "{set}_{k}.parquet"),
    params:
        settings=block("zerod"),
        portion=lambda wildcards: SETS[wildcards.set][int(wildcards.k)],
    log:
        log_of("zerod", "{set}_{k}.log"),
    script:
        "../scripts/zerod_chunk.py"
