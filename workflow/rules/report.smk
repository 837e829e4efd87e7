# Figures and report, from result files alone.

FIGURES = {
    "cardiac_function.png": {"fit": rules.calibration.output.fit},
    "flows.png": {"summary": rules.posterior.output.summary, "targets": rules.perfusion.output.targets},
}


rule figure:
    input:
        unpack(lambda wildcards: FIGURES[wildcards.figure]),
        code=code("coronaryuq.figures.draw"),
    output:
        figure=results("figures", "{figure}"),
    params:
        name=lambda wildcards: Path(wildcards.figure).stem,
    log:
        log_of("figures", "{figure}.log"),
    script:
        "../scripts/figure.py"


rule figures:
    input:
        expand(rules.figure.output.figure, figure=FIGURES),


rule report:
    input:
        figures=expand(rules.figure.output.figure, figure=FIGURES),
        estimates=rules.estimation.output.estimates,
        table=rules.estimation.output.table,
        code=code("coronaryuq.report.page"),
    output:
        report=results("report.html"),
    params:
        configuration=campaign.model_dump(mode="json"),
    log:
        log_of("report.log"),
    script:
        "../scripts/report.py"


rule paper_table:
    input:
        code=code("coronaryuq.estimation.stage"),
    output:
        table=results("paper_table.csv"),
    params:
        data=campaign.paper_data,
    log:
        log_of("paper_table.log"),
    script:
        "../scripts/paper_table.py"
