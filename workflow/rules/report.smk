# Figures and report, from result files alone.


rule figure:
    """Draw one figure."""
    input:
        unpack(lambda wildcards: figures[wildcards.figure]),
    output:
        figure=report(
            results("figures", "{figure}.png"),
            caption="../report/figure.rst",
            category=lambda wildcards: category_of(wildcards.figure),
            labels=lambda wildcards: labels_of(wildcards.figure),
        ),
        drawing=results("figures", "{figure}.svg"),
    log:
        log_of("figures", "{figure}.log"),
    wildcard_constraints:
        figure=alternatives(figures),
    # Nothing but the report waits for a figure.
    priority: -1
    params:
        **drawing(lambda wildcards: wildcards.figure),
    script:
        "../scripts/stage.py"


rule figures:
    """All figures of the campaign."""
    input:
        expand(rules.figure.output.figure, figure=figures),
        searches.figures if searches.in_report else [],


rule report:
    """Write the report; it quotes the mesh study unless `flow3d.mesh_study` is 0."""
    input:
        unpack(end_of_growth),
        **({"mesh_study": rules.mesh_study.output.out_json} if campaign.flow3d.mesh_study else {}),
        **({"losses_fit": rules.losses.output.fit_json, "losses": rules.losses.output.losses_csv} if teaches else {}),
        **({"adoption": rules.adoption_comparison.output.comparison_json} if adopts else {}),
        case=rules.case.output.case_json,
        tree=rules.case.output.tree_vtp,
        lv=rules.case.output.lv_vtu,
        pressures=rules.pressure_map.output.out_csv,
        predicted=rules.pressure_map.output.predicted_csv,
        fit=rules.calibration.output.fit_csv,
        targets=target_flows,
        summary=rules.posterior.output.summary,
        mesh=results("mesh", "mesh.json"),
        failures=rules.runs.output.failures,
        estimates=rules.estimation.output.estimates_json,
        budget=rules.budget.output.out_json,
        table=rules.estimation.output.table_csv,
        records=lambda wildcards: runs_of_campaign(wildcards)["records"],
        figures=expand(rules.figure.output.figure, figure=figures),
        drawings=expand(rules.figure.output.drawing, figure=figures),
        costs=costs_of_campaign,
        answers=searches.answers if searches.in_report else [],
        drawn=searches.figures if searches.in_report else [],
        truths=TRUTHS if searches.in_report else [],
    output:
        report=report(results("report.html"), caption="../report/page.rst", category="Summary"),
    log:
        log_of("report.log"),
    params:
        **stage("coronaryuq.campaign.jobs.report:write_report"),
        configuration=campaign.model_dump(mode="json"),
    script:
        "../scripts/stage.py"
