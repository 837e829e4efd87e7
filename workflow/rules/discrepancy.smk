# What the model is missing: a campaign of its own, `snakemake discrepancy`.
#
# Cases: the files that the configuration names, pairs of simulated and measured outputs, recorded animals; where it
# names none, an effect hidden in the campaign's own tuned loop.

from coronaryuq.discrepancy.data.conditions import drive_paths
from coronaryuq.discrepancy.settings import GIVEN

DISCREPANCY = campaign.discrepancy


def examined(case, *parts):
    return results("discrepancy", case, *parts)


def made(case):
    """Files of a case that a rule writes."""
    names = {"model": "model.json", "measurements": "measurements.csv", "conditions": "conditions.yaml"}
    return {name: examined(case, "case", file) for name, file in names.items()}


SEARCHED = {animal: made(animal) | {"drives": examined(animal, "case", "drives")} for animal in DISCREPANCY.animals}
if DISCREPANCY.measurements:
    SEARCHED["case"] = {
        "model": DISCREPANCY.model or rules.calibration.output.rest,
        "measurements": DISCREPANCY.measurements,
        "conditions": DISCREPANCY.conditions,
        "drives": drive_paths(DISCREPANCY.conditions),
    }
if not SEARCHED and not DISCREPANCY.pairs:
    SEARCHED["hidden"] = made("hidden")
EXAMINED = [*SEARCHED, *(["pairs"] if DISCREPANCY.pairs else [])]
NOT_SEARCHED_WITH = (
    "model",
    "measurements",
    "conditions",
    "pairs",
    "recordings",
    "animals",
    "held_out",
    "free_bed",
    "in_report",
    "benchmark",
)
HIDING = ("hidden_effect", "hidden_size")
DISCREPANCY_SETTINGS = block("discrepancy", without=(*NOT_SEARCHED_WITH, *HIDING))
HIDDEN_IN = DISCREPANCY.benchmark.named
NAMED_FILES = {
    "model": [DISCREPANCY.model],
    "measurements": [DISCREPANCY.measurements],
    "conditions": [DISCREPANCY.conditions, *map(str, SEARCHED["case"]["drives"] if "case" in SEARCHED else [])],
    "pairs": DISCREPANCY.pairs or (),
    "benchmark.networks": [one for one in HIDDEN_IN.values() if one not in GIVEN],
}
for field, paths in NAMED_FILES.items():
    for path in paths:
        if path and not Path(path).is_file():
            refuse(InputError("configuration", f"discrepancy.{field}", path, "no such file"))
recorded = {
    path.stem.removeprefix(f"{animal}_")
    for animal in DISCREPANCY.animals
    for path in Path(DISCREPANCY.recordings).glob(f"{animal}_*.csv")
}
for name in DISCREPANCY.held_out or ():
    if recorded and name not in recorded:
        remedy = f"not recorded; know {', '.join(sorted(recorded))}"
        refuse(InputError("configuration", "discrepancy.held_out", name, remedy))
for animal in DISCREPANCY.animals:
    if not any(Path(DISCREPANCY.recordings).glob(f"{animal}_*.csv")):
        remedy = f"no {animal}_CONDITION.csv in {DISCREPANCY.recordings}"
        refuse(InputError("configuration", "discrepancy.animals", animal, remedy))

DISCREPANCY_FIGURES = {
    (case, name): examined(case, "found", table)
    for case in SEARCHED
    for name, table in {
        "tree": "tree.csv",
        "residuals": "residuals.csv",
        "ranking": "ranking.csv",
        "sizes": "sizes.csv",
        "gap": "gap.csv",
    }.items()
}
if "hidden" in SEARCHED:
    DISCREPANCY_FIGURES["hidden", "gap"] = examined("hidden", "known", "gap.csv")
if DISCREPANCY.pairs:
    DISCREPANCY_FIGURES["pairs", "pairs"] = examined("pairs", "found", "pairs.csv")
    DISCREPANCY_FIGURES["pairs", "pairs_gap"] = examined("pairs", "found", "pairs.csv")
    DISCREPANCY_FIGURES["pairs", "pairs_effects"] = examined("pairs", "found", "effects.csv")


rule discrepancy_hidden:
    input:
        rest=rules.calibration.output.rest,
        code=code("coronaryuq.discrepancy.stage"),
    output:
        **made("hidden"),
        truth=examined("hidden", "case", "truth.json"),
    log:
        log_of("discrepancy_hidden.log"),
    params:
        settings=block("discrepancy", without=NOT_SEARCHED_WITH),
        seed=campaign.seed,
    script:
        "../scripts/discrepancy_hidden.py"


if DISCREPANCY.recordings:

    rule discrepancy_recordings:
        input:
            recordings=lambda wildcards: sorted(Path(DISCREPANCY.recordings).glob(f"{wildcards.animal}_*.csv")),
            code=code("coronaryuq.discrepancy.data.recordings"),
        output:
            **made("{animal}"),
            drives=directory(examined("{animal}", "case", "drives")),
        log:
            log_of("discrepancy_recordings", "{animal}.log"),
        wildcard_constraints:
            animal="|".join(map(re.escape, DISCREPANCY.animals)),
        params:
            folder=DISCREPANCY.recordings,
            animal=lambda wildcards: wildcards.animal,
            held_out=DISCREPANCY.held_out,
            free_bed=DISCREPANCY.free_bed,
        script:
            "../scripts/discrepancy_recordings.py"


rule discrepancy_search:
    input:
        unpack(lambda wildcards: SEARCHED[wildcards.case]),
        code=code("coronaryuq.discrepancy.stage"),
    output:
        answer=examined("{case}", "found", "discrepancy.json"),
        located=examined("{case}", "found", "located.csv"),
        residuals=examined("{case}", "found", "residuals.csv"),
        ranking=examined("{case}", "found", "ranking.csv"),
        sizes=examined("{case}", "found", "sizes.csv"),
        tree=examined("{case}", "found", "tree.csv"),
        gap=examined("{case}", "found", "gap.csv"),
        paragraph=examined("{case}", "found", "paragraph.txt"),
    log:
        log_of("discrepancy_search", "{case}.log"),
    wildcard_constraints:
        case="|".join(map(re.escape, SEARCHED)) or "none",
    threads: 2
    params:
        settings=DISCREPANCY_SETTINGS,
        seed=campaign.seed,
    script:
        "../scripts/discrepancy_search.py"


rule discrepancy_known:
    input:
        **made("hidden"),
        truth=rules.discrepancy_hidden.output.truth,
        gaps=examined("hidden", "found", "gap.csv"),
        answer=examined("hidden", "found", "discrepancy.json"),
        code=code("coronaryuq.discrepancy.stage"),
    output:
        table=examined("hidden", "known", "gap.csv"),
        reference=examined("hidden", "known", "gap.json"),
    log:
        log_of("discrepancy_known.log"),
    threads: 2
    params:
        settings=DISCREPANCY_SETTINGS,
        seed=campaign.seed,
    script:
        "../scripts/discrepancy_known.py"


if DISCREPANCY.pairs:

    rule discrepancy_pairs:
        input:
            simulated=DISCREPANCY.pairs[0],
            measured=DISCREPANCY.pairs[1],
            code=code("coronaryuq.discrepancy.table_model.search"),
        output:
            answer=examined("pairs", "found", "discrepancy.json"),
            pairs=examined("pairs", "found", "pairs.csv"),
            laws=examined("pairs", "found", "laws.csv"),
            effects=examined("pairs", "found", "effects.csv"),
            paragraph=examined("pairs", "found", "paragraph.txt"),
        log:
            log_of("discrepancy_pairs.log"),
        params:
            seed=campaign.seed,
        script:
            "../scripts/discrepancy_pairs.py"


rule discrepancy_figure:
    input:
        table=lambda wildcards: DISCREPANCY_FIGURES[wildcards.case, wildcards.figure],
        code=code("coronaryuq.figures.draw", "coronaryuq.figures.discrepancy"),
    output:
        figure=examined("{case}", "figures", "{figure}.png"),
    log:
        log_of("discrepancy_figure", "{case}_{figure}.log"),
    wildcard_constraints:
        case="|".join(map(re.escape, EXAMINED)),
        figure=r"\w+",
    params:
        name=lambda wildcards: f"discrepancy_{wildcards.figure}",
    script:
        "../scripts/figure.py"


DISCREPANCY_DRAWN = [examined(case, "figures", f"{name}.png") for case, name in DISCREPANCY_FIGURES]
DISCREPANCY_TRUTHS = []
if "hidden" in SEARCHED:
    DISCREPANCY_TRUTHS = [rules.discrepancy_hidden.output.truth, rules.discrepancy_known.output.reference]
DISCREPANCY_ANSWERS = [examined(case, "found", "discrepancy.json") for case in EXAMINED]


rule discrepancy_report:
    input:
        answers=DISCREPANCY_ANSWERS,
        figures=DISCREPANCY_DRAWN,
        truths=DISCREPANCY_TRUTHS,
        code=code("coronaryuq.report.discrepancy"),
        templates=report_templates("discrepancy.html", "discrepancy_page.html", "style.css"),
    output:
        report=results("discrepancy", "report.html"),
    log:
        log_of("discrepancy_report.log"),
    params:
        campaign=campaign.name,
        settings=block("discrepancy", without=("benchmark", *([] if "hidden" in SEARCHED else HIDING))),
    script:
        "../scripts/discrepancy_report.py"


rule discrepancy:
    input:
        rules.discrepancy_report.output.report,


def hidden_in(wildcards):
    """The network that effects are hidden in: a file, or none for the bundled tree."""
    chosen = HIDDEN_IN[wildcards.network]
    tuned = {"campaign": {"network": rules.calibration.output.rest}, "open_loop": {}}
    return tuned.get(chosen, {"network": chosen})


rule discrepancy_benchmark_seed:
    input:
        unpack(hidden_in),
        code=code("coronaryuq.bench.discrepancy.benchmark"),
    output:
        cases=examined("benchmark", "{network}", "seed_{seed}.json"),
    log:
        log_of("discrepancy_benchmark", "{network}_{seed}.log"),
    wildcard_constraints:
        network="|".join(map(re.escape, HIDDEN_IN)),
        seed=r"\d+",
    params:
        name=lambda wildcards: {"open_loop": "open loop"}.get(wildcards.network, wildcards.network),
        seed=lambda wildcards: int(wildcards.seed),
    script:
        "../scripts/discrepancy_benchmark.py"


FIRST_SEED = DISCREPANCY.benchmark.first_seed


rule discrepancy_benchmark_tables:
    input:
        cases=expand(
            rules.discrepancy_benchmark_seed.output.cases,
            network=HIDDEN_IN,
            seed=range(FIRST_SEED, FIRST_SEED + DISCREPANCY.benchmark.seeds),
        ),
        code=code("coronaryuq.bench.discrepancy.tables"),
    output:
        shares=examined("benchmark", "shares.csv"),
        cells=examined("benchmark", "cells.csv"),
        answers=examined("benchmark", "answers.csv"),
    log:
        log_of("discrepancy_benchmark", "tables.log"),
    script:
        "../scripts/discrepancy_benchmark_tables.py"


rule discrepancy_benchmark_figure:
    input:
        shares=rules.discrepancy_benchmark_tables.output.shares,
        answers=rules.discrepancy_benchmark_tables.output.answers,
        code=code("coronaryuq.figures.draw", "coronaryuq.figures.discrepancy_benchmark"),
    output:
        figure=examined("benchmark", "benchmark.png"),
    log:
        log_of("discrepancy_benchmark", "figure.log"),
    params:
        name="hidden_effects",
    script:
        "../scripts/figure.py"


rule discrepancy_benchmark:
    input:
        shares=rules.discrepancy_benchmark_tables.output.shares,
        cells=rules.discrepancy_benchmark_tables.output.cells,
        answers=rules.discrepancy_benchmark_tables.output.answers,
        figure=rules.discrepancy_benchmark_figure.output.figure,
        code=code("coronaryuq.report.discrepancy_benchmark"),
        templates=report_templates("discovery_page.html", "style.css"),
    output:
        report=examined("benchmark", "report.html"),
    log:
        log_of("discrepancy_benchmark", "report.log"),
    params:
        settings=DISCREPANCY.benchmark.model_dump(mode="json"),
    script:
        "../scripts/discrepancy_benchmark_report.py"
