# Search for missing effects: a separate campaign, `snakemake discrepancy`, and its benchmark.


rule discrepancy_hidden:
    """Hide an effect in the tuned loop and measure it."""
    input:
        rest=tuned,
    output:
        **searches.made("hidden"),
        truth=paths.discrepancy("hidden", "case", "truth.json"),
    log:
        log_of("discrepancy_hidden.log"),
    params:
        **stage("coronaryuq.discrepancy.stage:hide_in_loop"),
        settings=searches.block(hiding=True),
        seed=campaign.seed,
    script:
        "../scripts/stage.py"


rule discrepancy_recordings:
    """Convert the recordings of one animal to a case."""
    input:
        recordings=lambda wildcards: searches.recordings(wildcards.animal),
    output:
        **searches.made("{animal}"),
        drives=directory(paths.discrepancy("{animal}", "case", "drives")),
    log:
        log_of("discrepancy_recordings", "{animal}.log"),
    wildcard_constraints:
        animal=alternatives(campaign.discrepancy.animals),
    params:
        **stage("coronaryuq.discrepancy.data.recordings:prepare_case"),
        folder=campaign.discrepancy.recordings,
        animal=lambda wildcards: wildcards.animal,
        held_out=campaign.discrepancy.held_out,
        free_bed=campaign.discrepancy.free_bed,
    script:
        "../scripts/stage.py"


rule discrepancy_search:
    """Find the effects that a model is missing, from a network, measurements and their conditions."""
    input:
        unpack(lambda wildcards: searches.cases[wildcards.case]),
    output:
        answer=paths.discrepancy("{case}", "found", "discrepancy.json"),
        located=paths.discrepancy("{case}", "found", "located.csv"),
        residuals=paths.discrepancy("{case}", "found", "residuals.csv"),
        ranking=paths.discrepancy("{case}", "found", "ranking.csv"),
        sizes=paths.discrepancy("{case}", "found", "sizes.csv"),
        tree=paths.discrepancy("{case}", "found", "tree.csv"),
        gap=paths.discrepancy("{case}", "found", "gap.csv"),
        pullback=paths.discrepancy("{case}", "found", "pullback.csv"),
        source=paths.discrepancy("{case}", "found", "source.csv"),
        cost=cost_of("discrepancy_search_{case}.json"),
    log:
        log_of("discrepancy_search", "{case}.log"),
    wildcard_constraints:
        case=alternatives(searches.cases),
    threads: 2
    params:
        **stage("coronaryuq.discrepancy.search_case:search"),
        settings=searches.block(hiding=False),
        seed=campaign.seed,
    script:
        "../scripts/stage.py"


rule discrepancy_text:
    """Write the answer of a search in words; a separate rule, so that editing the text repeats no search."""
    input:
        answer_json=rules.discrepancy_search.output.answer,
    output:
        paragraph_txt=paths.discrepancy("{case}", "found", "paragraph.txt"),
    log:
        log_of("discrepancy_text", "{case}.log"),
    wildcard_constraints:
        case=alternatives(searches.cases),
    params:
        **stage("coronaryuq.discrepancy.result.summary_text:write_paragraph"),
    script:
        "../scripts/stage.py"


rule discrepancy_known:
    """Add the held-out gap with the true effect to those of a search to which it was unknown."""
    input:
        **searches.made("hidden"),
        truth=rules.discrepancy_hidden.output.truth,
        gaps=paths.discrepancy("hidden", "found", "gap.csv"),
        answer=paths.discrepancy("hidden", "found", "discrepancy.json"),
    output:
        table=paths.discrepancy("hidden", "known", "gap.csv"),
        reference=paths.discrepancy("hidden", "known", "gap.json"),
    log:
        log_of("discrepancy_known.log"),
    threads: 2
    params:
        **stage("coronaryuq.campaign.jobs.discrepancy:compare_with_truth"),
        settings=searches.block(hiding=False),
        seed=campaign.seed,
    script:
        "../scripts/stage.py"


rule discrepancy_pairs:
    """Find the effects that a table model is missing, from pairs of simulated and measured outputs."""
    input:
        simulated=(campaign.discrepancy.pairs or [[]])[0],
        measured=(campaign.discrepancy.pairs or [[]])[-1],
    output:
        answer=paths.discrepancy("pairs", "found", "discrepancy.json"),
        pairs=paths.discrepancy("pairs", "found", "pairs.csv"),
        laws=paths.discrepancy("pairs", "found", "laws.csv"),
        effects=paths.discrepancy("pairs", "found", "effects.csv"),
        predicted=paths.discrepancy("pairs", "found", "predicted.csv"),
        paragraph=paths.discrepancy("pairs", "found", "paragraph.txt"),
    log:
        log_of("discrepancy_pairs.log"),
    params:
        **stage("coronaryuq.discrepancy.table_model.search:discover_pairs"),
        seed=campaign.seed,
    script:
        "../scripts/stage.py"


rule discrepancy_figure:
    """Draw one figure of a search."""
    input:
        unpack(lambda wildcards: searches.drawn_from(wildcards.case, wildcards.figure)),
    output:
        figure=report(
            paths.discrepancy("{case}", "figures", "{figure}.png"),
            caption="../report/search.rst",
            category=lambda wildcards: category_of_search(wildcards.case == INVENTED),
            labels=lambda wildcards: {"case": wildcards.case} | labels_of(wildcards.figure, SEARCHES),
        ),
    log:
        log_of("discrepancy_figure", "{case}_{figure}.log"),
    wildcard_constraints:
        case=alternatives(searches.names),
        figure=r"\w+",
    params:
        **drawing(lambda wildcards: f"discrepancy_{wildcards.figure}"),
    script:
        "../scripts/stage.py"


TRUTHS = []
if "hidden" in searches.cases:
    TRUTHS = [rules.discrepancy_hidden.output.truth, rules.discrepancy_known.output.reference]


rule discrepancy_report:
    """Write the page of the searches."""
    input:
        **(searches.anatomy if searches.of_patient else {}),
        answers=answers_required,
        figures=searches.figures,
        truths=TRUTHS,
    output:
        out=report(results("discrepancy", "report.html"), caption="../report/searches.rst", category="Summary"),
    log:
        log_of("discrepancy_report.log"),
    params:
        **stage("coronaryuq.report.discrepancy:write_page"),
        campaign=campaign.name,
        settings=searches.shown(),
        of_patient=searches.of_patient,
    script:
        "../scripts/stage.py"


rule discrepancy:
    """All searches and their page."""
    input:
        rules.discrepancy_report.output.out,
        expand(rules.discrepancy_text.output.paragraph_txt, case=searches.cases),


rule discrepancy_benchmark_seed:
    """Hide effects in a network, one case per cell with one seed, and search for them."""
    input:
        unpack(lambda wildcards: searches.hidden_in(wildcards.network)),
    output:
        cases=paths.discrepancy("benchmark", "{network}", "seed_{seed}.json"),
    log:
        log_of("discrepancy_benchmark", "{network}_{seed}.log"),
    wildcard_constraints:
        network=alternatives(campaign.discrepancy.benchmark.named),
        seed=r"\d+",
    params:
        **stage("coronaryuq.campaign.jobs.discrepancy:benchmark_of_seed"),
        name=lambda wildcards: {"open_loop": "open loop"}.get(wildcards.network, wildcards.network),
        seed=lambda wildcards: int(wildcards.seed),
    script:
        "../scripts/stage.py"


rule discrepancy_benchmark_tables:
    """Gather the cases of all networks and seeds into tables."""
    input:
        found=expand(
            rules.discrepancy_benchmark_seed.output.cases,
            network=campaign.discrepancy.benchmark.named,
            seed=campaign.discrepancy.benchmark.all_seeds,
        ),
    output:
        shares_csv=paths.discrepancy("benchmark", "shares.csv"),
        cells_csv=paths.discrepancy("benchmark", "cells.csv"),
        answers_csv=paths.discrepancy("benchmark", "answers.csv"),
    log:
        log_of("discrepancy_benchmark", "tables.log"),
    params:
        **stage("coronaryuq.bench.discrepancy.tables:tabulate"),
    script:
        "../scripts/stage.py"


rule discrepancy_benchmark_figure:
    """Draw the fractions of correct answers."""
    input:
        shares=rules.discrepancy_benchmark_tables.output.shares_csv,
        answers=rules.discrepancy_benchmark_tables.output.answers_csv,
    output:
        figure=paths.discrepancy("benchmark", "benchmark.png"),
    log:
        log_of("discrepancy_benchmark", "figure.log"),
    params:
        **drawing(lambda wildcards: "hidden_effects"),
    script:
        "../scripts/stage.py"


rule discrepancy_benchmark:
    """Write the page of the benchmark."""
    input:
        shares=rules.discrepancy_benchmark_tables.output.shares_csv,
        cells=rules.discrepancy_benchmark_tables.output.cells_csv,
        answers=rules.discrepancy_benchmark_tables.output.answers_csv,
        figure=rules.discrepancy_benchmark_figure.output.figure,
    output:
        out=paths.discrepancy("benchmark", "report.html"),
    log:
        log_of("discrepancy_benchmark", "report.log"),
    params:
        **stage("coronaryuq.report.discrepancy_benchmark:write_page"),
        settings=campaign.discrepancy.benchmark.model_dump(mode="json"),
    script:
        "../scripts/stage.py"
