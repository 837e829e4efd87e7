# Stage two: the posterior of the outlet resistances, and the samples drawn from it.


rule posterior_chains:
    input:
        case=rules.case.output.case,
        network=rules.calibration.output.hyperaemia,
        targets=rules.perfusion.output.targets,
        code=code("coronaryuq.posterior.stage"),
        script=script_path("posterior_chains.py"),
    output:
        chains=results("posterior", "chains.npz"),
    log:
        log_of("posterior", "chains.log"),
    cache: True
    resources:
        mpi="mpiexec",
        tasks=2,
    params:
        given=as_json(settings=block("posterior"), seed=campaign.seed),
    shell:
        "{resources.mpi} -n {resources.tasks} python {input.script:q}"
        " --input case={input.case:q} network={input.network:q} targets={input.targets:q}"
        " --code {input.code:q} --output chains={output.chains:q} --params {params.given:q} --threads {threads} --log {log:q}"


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
        fractions=results("posterior", "fractions.csv"),
        fitted=results("posterior", "fitted.json"),
    log:
        log_of("posterior", "gather.log"),
    params:
        settings=block("posterior"),
        seed=campaign.seed,
    script:
        "../scripts/posterior_gather.py"


rule samples:
    input:
        draws=rules.posterior.output.draws,
        code=code("coronaryuq.posterior.stage"),
    output:
        samples=results("samples", "{set}.csv"),
    log:
        log_of("samples", "{set}.log"),
    params:
        settings=block("posterior"),
        seed=campaign.seed,
        set=lambda wildcards: wildcards.set,
        total=lambda wildcards: COUNTS[wildcards.set],
    script:
        "../scripts/samples.py"
