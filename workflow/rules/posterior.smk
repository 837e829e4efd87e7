# The posterior of the outlet resistances, and the samples drawn from it.


rule posterior_chains:
    """Run the DREAM chains; under mpiexec or srun the 0D runs are divided among ranks."""
    input:
        case_json=rules.case.output.case_json,
        hyperaemia_json=rules.calibration.output.hyperaemia_json,
        targets_json=rules.perfusion.output.out_json,
        script=workflow.source_path("../scripts/stage.py"),
    output:
        out_npz=results("posterior", "chains.npz"),
        cost=cost_of("posterior_chains.json"),
    log:
        log_of("posterior", "chains.log"),
    cache: cached
    resources:
        mpi="mpiexec",
        tasks=2,
    params:
        given=lambda wildcards: as_json(
            stage("coronaryuq.posterior.stage:sample"), settings=block("posterior"), seed=campaign.seed
        ),
    shell:
        "{resources.mpi} -n {resources.tasks} python {input.script:q} --name posterior_chains"
        " --input case_json={input.case_json:q} hyperaemia_json={input.hyperaemia_json:q}"
        " targets_json={input.targets_json:q} --output out_npz={output.out_npz:q} cost={output.cost:q}"
        " --params {params.given:q} --threads {threads} --log {log:q}"


rule posterior:
    """Gather the chains: posterior, draws, convergence, predictive checks."""
    input:
        case_json=rules.case.output.case_json,
        hyperaemia_json=rules.calibration.output.hyperaemia_json,
        targets_json=rules.perfusion.output.out_json,
        chains_npz=rules.posterior_chains.output.out_npz,
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
        draws_csv=rules.posterior.output.draws,
    output:
        out_csv=results("samples", "{set}.csv"),
    log:
        log_of("samples", "{set}.log"),
    params:
        **stage("coronaryuq.posterior.stage:draw_samples"),
        settings=block("posterior"),
        seed=campaign.seed,
        name=lambda wildcards: wildcards.set,
        number=lambda wildcards: targets.counts[wildcards.set],
    script:
        "../scripts/stage.py"
