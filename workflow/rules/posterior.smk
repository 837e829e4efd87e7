# Stage two: the posterior of the outlet resistances, and the samples drawn from it.


rule posterior_chains:
    input:
        case=rules.case.output.case,
        network=rules.calibration.output.hyperaemia,
        targets=rules.perfusion.output.targets,
        code=code("coronaryuq.posterior.stage"),
        script=script("posterior_chains.py"),
    output:
        chains=results("posterior", "chains.npz"),
    params:
        settings=block("posterior"),
        seed=campaign.seed,
    log:
        log_of("posterior", "chains.log"),
    threads: 2
    script:
        "../scripts/posterior_chains.py"


rule posterior:
    input:
        case=rules.case.output.case,
        network=rules.calibration.output.hyperaemia,
        targets=rules.perfusion.output.targets,
        chains=rules.posterior_chains.output.chains,
        code=code("coronaryuq.posterior.stage"),
    output:
        posterior=results("posterior", "posterior.nc"),
        draws=results("posterior", "draws.csv"),
        summary=results("posterior", "summary.json"),
    params:
        settings=block("posterior"),
        seed=campaign.seed,
    log:
        log_of("posterior", "gather.log"),
    script:
        "../scripts/posterior_gather.py"


rule samples:
    input:
        draws=rules.posterior.output.draws,
        code=code("coronaryuq.posterior.stage"),
    output:
        samples=results("samples", "{set}_{k}.csv"),
    params:
        settings=block("posterior"),
        seed=campaign.seed,
        set=lambda wildcards: wildcards.set,
        portion=lambda wildcards: SETS[wildcards.set][int(wildcards.k)],
    log:
        log_of("samples", "{set}_{k}.log"),
    script:
        "../scripts/samples.py"
