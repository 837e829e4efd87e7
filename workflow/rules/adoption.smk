# Adoption of what the search named and confirmed: the loop is tuned once for the search, and again with its answer.


use rule calibration as adoption_calibration with:
    input:
        case_json=rules.case.output.case_json,
        network_json=untuned,
        targets_json=rules.perfusion.output.out_json,
    output:
        rest_json=results("adopted", "before", "rest.json"),
        hyperaemia_json=results("adopted", "before", "hyperaemia.json"),
        parameters_csv=results("adopted", "before", "parameters.csv"),
        fit_csv=results("adopted", "before", "fit.csv"),
        cost=cost_of("adopted", "calibration.json"),
    log:
        log_of("adopted", "calibration.log"),


ADOPTED_CASE = searches.adopted or "none"


rule adopt:
    """Write the network with the effects that the search named and confirmed; the same network if there are none."""
    input:
        case_json=rules.case.output.case_json,
        base_json=untuned,
        searched_json=rules.adoption_calibration.output.rest_json,
        answer_json=paths.discrepancy(ADOPTED_CASE, "found", "discrepancy.json"),
        residuals_csv=paths.discrepancy(ADOPTED_CASE, "found", "residuals.csv"),
        measurements=searches.cases.get(ADOPTED_CASE, {}).get("measurements", []),
        perfusion_json=rules.perfusion.output.out_json,
    output:
        network_json=results("adopted", "network.json"),
        targets_json=results("adopted", "targets.json"),
        adoption_json=results("adopted", "adoption.json"),
    log:
        log_of("adopted", "adopt.log"),
    params:
        **stage("coronaryuq.adoption.stage:adopt"),
        map_condition=given.map_condition if ADOPTED_CASE == "case" else None,
    script:
        "../scripts/stage.py"


rule adopted_in_3d:
    """Write the tuned loop for 3D runs, with narrowings inside the mesh as the shape of its lumen."""
    input:
        hyperaemia_json=rules.calibration.output.hyperaemia_json,
        case_network_json=rules.case.output.network_json,
        mesh_json=results("mesh", "mesh.json"),
        case_json=rules.case.output.case_json,
        tree_vtp=rules.case.output.tree_vtp,
    output:
        out_json=results("adopted", "hyperaemia_3d.json"),
        in_3d_json=results("adopted", "in_3d.json"),
    log:
        log_of("adopted", "in_3d.log"),
    params:
        **stage("coronaryuq.adoption.stage:in_3d"),
        stenosis_loss=campaign.patient.stenosis_loss,
    script:
        "../scripts/stage.py"


# The posterior without what was adopted, to compare predictions.
use rule posterior_chains as adoption_chains with:
    input:
        before=[],
        case_json=rules.case.output.case_json,
        hyperaemia_json=rules.adoption_calibration.output.hyperaemia_json,
        targets_json=rules.perfusion.output.out_json,
        script=workflow.source_path("../scripts/stage.py"),
    output:
        out_npz=results("adopted", "before", "length_{length}", "chains.npz"),
        cost=cost_of("adopted", "chains_{length}.json"),
    log:
        log_of("adopted", "chains_{length}.log"),


use rule posterior_draws as adoption_draws with:
    input:
        chains_npz=rules.adoption_chains.output.out_npz,
    output:
        out_csv=results("adopted", "before", "length_{length}", "draws.csv"),
    log:
        log_of("adopted", "draws_{length}.log"),


DRAWS_OF = {"before": results("adopted", "before", "length_1", "draws.csv"), "after": draws(FIRST_CHAINS)}
LOOP_OF = {
    "before": rules.adoption_calibration.output.hyperaemia_json,
    "after": rules.calibration.output.hyperaemia_json,
}


rule adoption_prediction:
    """Predict FFR by 0D, with the same samples before and after adoption."""
    input:
        network_json=lambda wildcards: LOOP_OF[wildcards.when],
        case_json=rules.case.output.case_json,
        draws_csv=lambda wildcards: DRAWS_OF[wildcards.when],
    output:
        out_csv=results("adopted", "ffr_{when}.csv"),
        cost=cost_of("adopted", "{when}.json"),
    log:
        log_of("adopted", "{when}.log"),
    wildcard_constraints:
        when=alternatives(DRAWS_OF),
    params:
        **stage("coronaryuq.campaign.jobs.adoption:prediction"),
        settings=block("zerod"),
        posterior=block("posterior"),
        seed=campaign.seed,
        number=min(campaign.samples.n_0d, 1000),
    script:
        "../scripts/stage.py"


rule adoption_comparison:
    """Compare the predictions before and after adoption."""
    input:
        **({"in_3d_json": rules.adopted_in_3d.output.in_3d_json} if given.in_3d else {}),
        case_json=rules.case.output.case_json,
        adoption_json=rules.adopt.output.adoption_json,
        before_csv=results("adopted", "ffr_before.csv"),
        after_csv=results("adopted", "ffr_after.csv"),
    output:
        comparison_json=results("adopted", "comparison.json"),
    log:
        log_of("adopted", "comparison.log"),
    params:
        **stage("coronaryuq.adoption.stage:compare"),
        zones=campaign.estimation.ffr_zones,
    script:
        "../scripts/stage.py"


rule adopted:
    """What the campaign adopted, and its prediction before and after."""
    input:
        adoption_required,
