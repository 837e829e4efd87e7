# What the model is missing: a campaign of its own, `snakemake discrepancy`.

DISCREPANCY = campaign.discrepancy
EXAMINED = {
    "model": DISCREPANCY.model or results("discrepancy", "case", "model.json"),
    "measurements": DISCREPANCY.measurements or results("discrepancy", "case", "measurements.csv"),
    "conditions": DISCREPANCY.conditions or results("discrepancy", "case", "conditions.yaml"),
}

if not DISCREPANCY.measurements:

    rule discrepancy_case:
        input:
            rest=rules.calibration.output.rest,
            code=code("coronaryuq.discrepancy.stage"),
        output:
            model=results("discrepancy", "case", "model.json"),
            measurements=results("discrepancy", "case", "measurements.csv"),
            conditions=results("discrepancy", "case", "conditions.yaml"),
            truth=results("discrepancy", "case", "truth.json"),
        log:
            log_of("discrepancy_case.log"),
        params:
            settings=block("discrepancy"),
            seed=campaign.seed,
        script:
            "../scripts/discrepancy_case.py"


rule discrepancy_search:
    input:
        **EXAMINED,
        code=code("coronaryuq.discrepancy.stage"),
    output:
        answer=results("discrepancy", "found", "discrepancy.json"),
        located=results("discrepancy", "found", "located.csv"),
        residuals=results("discrepancy", "found", "residuals.csv"),
        ranking=results("discrepancy", "found", "ranking.csv"),
        sizes=results("discrepancy", "found", "sizes.csv"),
        tree=results("discrepancy", "found", "tree.csv"),
        gap=results("discrepancy", "found", "gap.csv"),
        paragraph=results("discrepancy", "found", "paragraph.txt"),
    log:
        log_of("discrepancy.log"),
    threads: 2
    params:
        settings=block("discrepancy"),
        seed=campaign.seed,
    script:
        "../scripts/discrepancy_search.py"


rule discrepancy:
    input:
        rules.discrepancy_search.output.answer,
