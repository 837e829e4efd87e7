# The published runs: the paper's table, figures and convergence study; the coverage of the intervals.


rule paper_table:
    """Compute the paper's table from its published runs, next to the paper's columns."""
    output:
        table_csv=results("paper_table.csv"),
        estimates=results("paper", "estimates.json"),
        pairs=results("paper", "pairs.csv"),
        budget=results("paper", "budget.json"),
    log:
        log_of("paper_table.log"),
    params:
        **stage("coronaryuq.campaign.jobs.paper:table"),
        data=campaign.paper_data,
        settings=block("estimation"),
        seed=campaign.seed,
    script:
        "../scripts/stage.py"


rule paper_figure:
    """Draw figure 3, 4, 5 or 7 of the published runs."""
    input:
        unpack(lambda wildcards: paper_figures[wildcards.figure]),
    output:
        figure=results("paper", "{figure}.png"),
    log:
        log_of("paper", "{figure}.log"),
    wildcard_constraints:
        figure=alternatives(paper_figures),
    params:
        **drawing(lambda wildcards: wildcards.figure),
    script:
        "../scripts/stage.py"


rule paper_figures:
    """Figures 3, 4, 5 and 7 of the published runs."""
    input:
        expand(rules.paper_figure.output.figure, figure=paper_figures),


rule paper_convergence:
    """Compute the convergence study of the published runs."""
    output:
        out_json=results("paper", "convergence.json"),
    log:
        log_of("paper", "convergence.log"),
    params:
        **stage("coronaryuq.campaign.jobs.paper:convergence"),
        data=campaign.paper_data,
        settings=block("estimation"),
        seed=campaign.seed,
    script:
        "../scripts/stage.py"


rule paper_convergence_figure:
    """Draw figure 6 of the published runs."""
    input:
        convergence=rules.paper_convergence.output.out_json,
    output:
        figure=results("paper", "convergence.png"),
    log:
        log_of("paper", "convergence_figure.log"),
    params:
        **drawing(lambda wildcards: "convergence"),
    script:
        "../scripts/stage.py"


rule coverage_of_size:
    """Measure the coverage of the intervals at one pilot size."""
    output:
        cells=results("coverage", "n_{n}.json"),
    log:
        log_of("coverage", "n_{n}.log"),
    wildcard_constraints:
        n=r"\d+",
    params:
        **stage("coronaryuq.campaign.jobs.coverage:coverage_of_size"),
        data=campaign.paper_data,
        size=lambda wildcards: int(wildcards.n),
        trials=campaign.estimation.coverage_replicates,
    script:
        "../scripts/stage.py"


rule coverage_table:
    """Gather the coverage at all pilot sizes."""
    input:
        found=expand(rules.coverage_of_size.output.cells, n=campaign.estimation.coverage_sizes),
    output:
        table_csv=results("coverage", "table.csv"),
    log:
        log_of("coverage", "table.log"),
    params:
        **stage("coronaryuq.bench.estimation.coverage:tabulate"),
    script:
        "../scripts/stage.py"


rule coverage_figure:
    """Draw the coverage against the number of 3D runs."""
    input:
        table=rules.coverage_table.output.table_csv,
    output:
        figure=results("coverage", "coverage.png"),
    log:
        log_of("coverage", "figure.log"),
    params:
        **drawing(lambda wildcards: "coverage"),
    script:
        "../scripts/stage.py"


rule coverage:
    """Coverage of the intervals: table and figure."""
    input:
        rules.coverage_table.output.table_csv,
        rules.coverage_figure.output.figure,
