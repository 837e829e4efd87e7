# The patient: the bundled one is generated, any other is read; both become a checked case of the same form.

PATIENT = results("patient", "case.yaml") if campaign.case == "bundled" else campaign.case
BUNDLED = [results("patient", name) for name in ("tree.vtp", "lv.vtu", "outlets.csv", "targets.csv")]


rule bundled_patient:
    """Make the bundled patient in the formats of a real case."""
    output:
        case_yaml=results("patient", "case.yaml"),
        truth=results("patient", "truth.json"),
        files=BUNDLED,
    log:
        log_of("bundled_patient.log"),
    params:
        **stage("coronaryuq.synthetic.stage:write_patient"),
        settings=block("synthetic"),
        # The patient's own seed: another seed of the campaign draws other noise for the same patient.
        seed=campaign.synthetic.anatomy_seed,
    script:
        "../scripts/stage.py"


rule case:
    """Check a case and write the files from which every later stage starts."""
    input:
        case_yaml=PATIENT,
        files=BUNDLED if campaign.case == "bundled" else [f for path in given.named for f in files_under(path)],
    output:
        case_json=results("case", "case.json"),
        tree_vtp=results("case", "tree.vtp"),
        network_json=results("case", "network.json"),
        lv_vtu=results("case", "lv.vtu"),
        cost=cost_of("case.json"),
    log:
        log_of("case.log"),
    params:
        **stage("coronaryuq.case.stage:prepare_case"),
        settings=block("patient"),
        uncertainty=campaign.uncertainty,
    script:
        "../scripts/stage.py"
