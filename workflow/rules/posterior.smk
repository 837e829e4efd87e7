# The posterior of the outlet resistances, and the samples drawn from it. A growing campaign makes its chains longer:
# `length` is that of what follows burn-in, over that of the first chains.


rule posterior_chains:
    """Run the DREAM chains, or continue shorter ones; under mpiexec or srun the 0D runs are divided among ranks."""
    input:
        before=shorter_chains,
        case_json=rules.case.output.case_json,
        hyperaemia_json=rules.calibration.output.hyperaemia_json,
        targets_json=target_flows,
        script=workflow.source_path("../scripts/stage.py"),
    output:
        out_npz=results("posterior", "length_{length}", "chains.npz"),
        cost=cost_of("posterior_chains_{length}.json"),
    log:
        log_of("posterior", "chains_{length}.log"),
    cache: cached
    resources:
        mpi=LOCAL_MPIEXEC,
        tasks=2,
    params:
        given=lambda wildcards: as_json(
            stage("coronaryuq.campaign.jobs.posterior:make_chains"),
            settings=block("posterior"),
            seed=campaign.seed,
            length=int(wildcards.length),
        ),
    shell:
        "{resources.mpi} -n {resources.tasks} python {input.script:q} --name 'posterior_chains {wildcards.length}'"
        " --input case_json={input.case_json:q} hyperaemia_json={input.hyperaemia_json:q}"
        " targets_json={input.targets_json:q} before={input.before:q} --output out_npz={output.out_npz:q}"
        " cost={output.cost:q} --params {params.given:q} --threads {threads} --ranks {resources.tasks} --log {log:q}"


rule posterior_draws:
    """Write the thinned draws of the chains of one length, from which samples are drawn."""
    input:
        chains_npz=rules.posterior_chains.output.out_npz,
    output:
        out_csv=results("posterior", "length_{length}", "draws.csv"),
    log:
        log_of("posterior", "draws_{length}.log"),
    params:
        **stage("coronaryuq.posterior.stage:thin"),
        settings=block("posterior"),
    script:
        "../scripts/stage.py"


rule posterior:
    """Gather the longest chains: posterior, draws, convergence, predictive checks."""
    input:
        unpack(longest_chains),
        case_json=rules.case.output.case_json,
        hyperaemia_json=rules.calibration.output.hyperaemia_json,
        targets_json=target_flows,
    output:
        posterior=results("posterior", "posterior.nc"),
        draws=results("posterior", "draws.csv"),
        summary=results("posterior", "summary.json"),
        fractions=results("posterior", "fractions.csv"),
        fitted=results("posterior", "fitted.json"),
        cost=cost_of("posterior.json"),
    log:
        log_of("posterior", "gather.log"),
    params:
        **stage("coronaryuq.campaign.jobs.posterior:gather_chains"),
        settings=block("posterior"),
        seed=campaign.seed,
    script:
        "../scripts/stage.py"


rule samples:
    """Draw the samples of one table of inputs."""
    input:
        unpack(draws_of_set),
    output:
        out_csv=results("samples", "{set}.csv"),
    log:
        log_of("samples", "{set}.log"),
    params:
        **stage("coronaryuq.campaign.jobs.posterior:draw_set"),
        settings=block("posterior"),
        seed=campaign.seed,
        name=lambda wildcards: wildcards.set,
        number=lambda wildcards: targets.counts[wildcards.set],
    script:
        "../scripts/stage.py"
