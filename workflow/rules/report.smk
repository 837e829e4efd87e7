# Figures and report, from result files alone.

from coronaryuq.figures.draw import FIGURES as DRAWN

HELD_BACK = 20  # 3D runs that the convergence study keeps to judge a subsample by

FIGURES = {
    "territories": {"case": rules.case.output.case, "lv": rules.case.output.lv, "tree": rules.case.output.tree},
    "cardiac_function": {"fit": rules.calibration.output.fit},
    "marginals": {"posterior": rules.posterior.output.posterior, "case": rules.case.output.case},
    "tree_ffr": {
        "case": rules.case.output.case,
        "tree": rules.case.output.tree,
        "pressures": rules.pressure_map.output.pressures,
    },
    "osi_scatter": {"pairs": rules.estimation.output.pairs},
    "intervals_wss": {"estimates": rules.estimation.output.estimates},
    "intervals_ffr": {"estimates": rules.estimation.output.estimates},
    "budget": {"budget": rules.budget.output.budget},
}
for name in ("flows", "flow_covariance"):
    FIGURES[name] = {
        "posterior": rules.posterior.output.posterior,
        "case": rules.case.output.case,
        "targets": rules.perfusion.output.targets,
        "summary": rules.posterior.output.summary,
    }
if min(campaign.estimation.convergence_sizes, default=0) <= campaign.samples.n_3d - HELD_BACK:
    FIGURES["convergence"] = {"convergence": rules.convergence.output.convergence}
if campaign.backend == "ensemble" and campaign.flow3d.fields:
    for name in ("lumen", "walls"):
        FIGURES[name] = {
            "fields": results("flow3d", "fields_0.zip"),
            "case": rules.case.output.case,
            "tree": rules.case.output.tree,
        }


rule figure:
    input:
        unpack(lambda wildcards: FIGURES[wildcards.figure]),
        code=lambda wildcards: code("coronaryuq.figures.draw", DRAWN[wildcards.figure].split(":")[0]),
    output:
        figure=results("figures", "{figure}.png"),
    log:
        log_of("figures", "{figure}.log"),
    params:
        name=lambda wildcards: wildcards.figure,
    script:
        "../scripts/figure.py"


rule figures:
    input:
        expand(rules.figure.output.figure, figure=FIGURES),
        DISCREPANCY_DRAWN if campaign.discrepancy.in_report else [],


# The mesh study is run on demand. The report quotes one that is there and asks for none, so that a campaign never pays
# for one by the way; what it quotes is a parameter, and the page says so where the mesh has changed since.
study = results("mesh_study", "mesh_study.json")
MESH_STUDY = {"path": study, "checksum": provenance.checksum(study)} if Path(study).exists() else {}


rule report:
    input:
        unpack(end_of_growth),
        case=rules.case.output.case,
        fit=rules.calibration.output.fit,
        targets=rules.perfusion.output.targets,
        summary=rules.posterior.output.summary,
        mesh=rules.mesh.output.description,
        failures=rules.runs.output.failures,
        estimates=rules.estimation.output.estimates,
        budget=rules.budget.output.budget,
        figures=expand(rules.figure.output.figure, figure=FIGURES),
        answers=DISCREPANCY_ANSWERS if campaign.discrepancy.in_report else [],
        drawn=DISCREPANCY_DRAWN if campaign.discrepancy.in_report else [],
        truths=DISCREPANCY_TRUTHS if campaign.discrepancy.in_report else [],
        code=code("coronaryuq.report.page"),
        templates=report_templates("template.html", "discrepancy.html", "style.css"),
    output:
        report=results("report.html"),
    log:
        log_of("report.log"),
    params:
        configuration=campaign.model_dump(mode="json"),
        mesh_study=MESH_STUDY,
    script:
        "../scripts/report.py"


rule paper_table:
    input:
        code=code("coronaryuq.estimation.campaign.paper_table"),
    output:
        table=results("paper_table.csv"),
        estimates=results("paper", "estimates.json"),
        pairs=results("paper", "pairs.csv"),
        budget=results("paper", "budget.json"),
    log:
        log_of("paper_table.log"),
    params:
        data=campaign.paper_data,
        settings=block("estimation"),
        seed=campaign.seed,
    script:
        "../scripts/paper_table.py"


# Figures 3, 4, 5 and 7 of the published runs; figure 6 is `paper_convergence_figure`.
PAPER_FIGURES = {
    "osi_scatter": {"pairs": rules.paper_table.output.pairs},
    "intervals_wss": {"estimates": rules.paper_table.output.estimates},
    "intervals_ffr": {"estimates": rules.paper_table.output.estimates},
    "budget": {"budget": rules.paper_table.output.budget},
}


rule paper_figure:
    input:
        unpack(lambda wildcards: PAPER_FIGURES[wildcards.figure]),
        code=lambda wildcards: code("coronaryuq.figures.draw", DRAWN[wildcards.figure].split(":")[0]),
    output:
        figure=results("paper", "{figure}.png"),
    log:
        log_of("paper", "{figure}.log"),
    wildcard_constraints:
        figure="|".join(PAPER_FIGURES),
    params:
        name=lambda wildcards: wildcards.figure,
    script:
        "../scripts/figure.py"


rule paper_figures:
    input:
        expand(rules.paper_figure.output.figure, figure=PAPER_FIGURES),
