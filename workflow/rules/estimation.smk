# Estimates: runs gathered in the published format, shared space trained, 0D rerun at the resampled inputs, the table.

RESAMPLED = range(campaign.samples.chunks_resampled if campaign.estimation.autoencoder else 0)


FIRST_COUNTS = {"n_3d": campaign.samples.n_3d, "n_0d": campaign.samples.n_0d}


# Tables of the coarse level, where there is one.
COARSE_TABLES = ("params_coarse", "outputs_3d_coarse", "outputs_0d_coarse") if COARSE.runs_per_fine else ()


def decision(number):
    """What round `number` of a growing campaign decided; Snakemake runs the round first."""
    return read_json(checkpoints.allocation.get(r=number).output.round)


def last_round():
    return next(number for number in range(campaign.estimation.rounds) if decision(number)["done"])


def runs_of(counts):
    """Files that hold the first `counts` runs."""

    def first(portioned, total):
        return [k for k, (start, _) in portioned.items() if start < total]

    coarse = COARSE.runs_per_fine * counts["n_3d"]
    pilot = first(CHUNKS["pilot"], max(coarse, counts["n_3d"]))
    return {
        "records": expand(rules.flow3d_batch.output.records, k=first(BATCHES, counts["n_3d"])),
        "coarse": expand(rules.coarse_batch.output.records, k=first(COARSE_BATCHES, coarse)),
        "zerod_pilot": expand(results("zerod", "pilot_{k}.parquet"), k=pilot),
        "zerod_propagation": expand(
            results("zerod", "propagation_{k}.parquet"), k=first(CHUNKS["propagation"], counts["n_0d"])
        ),
    }


def runs_of_round(wildcards):
    number = int(wildcards.r)
    if number == 0:
        return runs_of(FIRST_COUNTS)
    return runs_of(decision(number - 1)["next"]) | {"before": results("allocation", f"round_{number - 1}.json")}


def end_of_growth(wildcards):
    """What the last round of a growing campaign decided, by name."""
    return {"allocation": results("allocation", f"round_{last_round()}.json")} if GROWS else {}


def runs_of_campaign(wildcards):
    counts = decision(last_round())["counts"] if GROWS else FIRST_COUNTS
    return runs_of(counts) | end_of_growth(wildcards)


checkpoint allocation:
    input:
        unpack(runs_of_round),
        case=rules.case.output.case,
        pilot=results("samples", "pilot.csv"),
        propagation=results("samples", "propagation.csv"),
        code=code("coronaryuq.estimation.campaign.allocation"),
    output:
        round=results("allocation", "round_{r}.json"),
    log:
        log_of("allocation", "round_{r}.log"),
    wildcard_constraints:
        r=r"\d+",
    params:
        settings=block("estimation"),
        posterior=block("posterior"),
        seed=campaign.seed,
        number=lambda wildcards: int(wildcards.r),
        first=FIRST_COUNTS,
        runs_per_fine=COARSE.runs_per_fine,
        portion={"n_3d": campaign.samples.batch_3d, "n_0d": campaign.samples.chunk_0d},
    script:
        "../scripts/allocation.py"


rule runs:
    input:
        unpack(runs_of_campaign),
        case=rules.case.output.case,
        pilot=results("samples", "pilot.csv"),
        propagation=results("samples", "propagation.csv"),
        code=code("coronaryuq.estimation.runs.gather"),
    output:
        **{name: results("runs", f"{name}.csv") for name in COARSE_TABLES},
        params=results("runs", "params.csv"),
        outputs_3d=results("runs", "outputs_3d.csv"),
        outputs_0d=results("runs", "outputs_0d.csv"),
        params_propagation=results("runs", "params_propagation.csv"),
        outputs_0d_propagation=results("runs", "outputs_0d_propagation.csv"),
        limits=results("runs", "param_limits.json"),
        rows=results("runs", "rows.csv"),
        failures=results("runs", "failures.json"),
    log:
        log_of("runs.log"),
    params:
        settings=block("estimation"),
        posterior=block("posterior"),
        counts=FIRST_COUNTS,
        runs_per_fine=COARSE.runs_per_fine,
    script:
        "../scripts/runs.py"


rule estimation_train:
    input:
        **{name: path for name, path in rules.runs.output.items()},
        code=code("coronaryuq.estimation.stage"),
    output:
        networks=results("estimation", "networks.npz"),
        resampled=results("estimation", "resampled.csv"),
    log:
        log_of("estimation", "train.log"),
    cache: True
    threads: 2
    params:
        settings=block("estimation"),
        seed=campaign.seed,
    script:
        "../scripts/estimation_train.py"


rule zerod_resampled:
    input:
        case=rules.case.output.case,
        network=rules.calibration.output.hyperaemia,
        samples=rules.estimation_train.output.resampled,
        code=code("coronaryuq.zerod.stage"),
    output:
        runs=results("zerod", "resampled_{k}.parquet"),
    log:
        log_of("zerod", "resampled_{k}.log"),
    cache: True
    params:
        settings=block("zerod"),
        # How many runs there are is known when the networks are trained; every job takes its share.
        share=lambda wildcards: [int(wildcards.k), len(RESAMPLED)],
    script:
        "../scripts/zerod_resampled.py"


rule estimation:
    input:
        **{name: path for name, path in rules.runs.output.items()},
        networks=rules.estimation_train.output.networks,
        zerod=expand(rules.zerod_resampled.output.runs, k=RESAMPLED),
        code=code("coronaryuq.estimation.stage", "coronaryuq.estimation.campaign.pairs_table"),
    output:
        estimates=results("estimation", "estimates.json"),
        table=results("estimation", "table.csv"),
        pairs=results("estimation", "pairs.csv"),
    log:
        log_of("estimation", "estimates.log"),
    params:
        settings=block("estimation"),
        seed=campaign.seed,
    script:
        "../scripts/estimation.py"


rule convergence:
    input:
        **{name: path for name, path in rules.runs.output.items()},
        code=code("coronaryuq.estimation.stage"),
    output:
        convergence=results("estimation", "convergence.json"),
    log:
        log_of("estimation", "convergence.log"),
    params:
        settings=block("estimation"),
        seed=campaign.seed,
    script:
        "../scripts/convergence.py"


rule budget:
    input:
        estimates=rules.estimation.output.estimates,
        failures=rules.runs.output.failures,
        code=code("coronaryuq.estimation.stage"),
    output:
        budget=results("estimation", "budget.json"),
    log:
        log_of("estimation", "budget.log"),
    params:
        settings=block("estimation"),
    script:
        "../scripts/budget.py"


rule paper_convergence:
    input:
        code=code("coronaryuq.estimation.stage"),
    output:
        convergence=results("paper", "convergence.json"),
    log:
        log_of("paper", "convergence.log"),
    params:
        data=campaign.paper_data,
        settings=block("estimation"),
        seed=campaign.seed,
    script:
        "../scripts/paper_convergence.py"


rule paper_convergence_figure:
    input:
        convergence=rules.paper_convergence.output.convergence,
        code=code("coronaryuq.figures.draw", "coronaryuq.figures.budget"),
    output:
        figure=results("paper", "convergence.png"),
    log:
        log_of("paper", "convergence_figure.log"),
    params:
        name="convergence",
    script:
        "../scripts/figure.py"


rule coverage_of_size:
    input:
        code=code("coronaryuq.bench.estimation.coverage"),
    output:
        cells=results("coverage", "n_{n}.json"),
    log:
        log_of("coverage", "n_{n}.log"),
    wildcard_constraints:
        n=r"\d+",
    params:
        data=campaign.paper_data,
        size=lambda wildcards: int(wildcards.n),
        trials=campaign.estimation.coverage_trials,
    script:
        "../scripts/interval_coverage.py"


rule coverage_table:
    input:
        cells=expand(rules.coverage_of_size.output.cells, n=campaign.estimation.coverage_sizes),
        code=code("coronaryuq.bench.estimation.coverage"),
    output:
        table=results("coverage", "table.csv"),
    log:
        log_of("coverage", "table.log"),
    script:
        "../scripts/coverage_table.py"


rule coverage_figure:
    input:
        table=rules.coverage_table.output.table,
        code=code("coronaryuq.figures.draw", "coronaryuq.figures.coverage"),
    output:
        figure=results("coverage", "coverage.png"),
    log:
        log_of("coverage", "figure.log"),
    params:
        name="coverage",
    script:
        "../scripts/figure.py"


rule coverage:
    input:
        rules.coverage_table.output.table,
        rules.coverage_figure.output.figure,


rule tuning:
    input:
        **{name: path for name, path in rules.runs.output.items()},
        code=code("coronaryuq.estimation.campaign.tuning"),
    output:
        tuning=results("estimation", "tuning.json"),
    log:
        log_of("estimation", "tuning.log"),
    params:
        settings=block("estimation"),
        seed=campaign.seed,
    script:
        "../scripts/tuning.py"
