# The patient: the bundled one is made, any other is read; both become the same checked case.

PATIENT = results("patient", "case.yaml") if campaign.case == "bundled" else campaign.case
BUNDLED = [results("patient", name) for name in ("tree.vtp", "lv.vtu", "outlets.csv", "targets.csv")]


rule bundled_patient:
    input:
        code=code("coronaryuq.synthetic.stage"),
    output:
        case=results("patient", "case.yaml"),
        truth=results("patient", "truth.json"),
        files=BUNDLED,
    log:
        log_of("bundled_patient.log"),
    params:
        settings=block("synthetic"),
        # The patient's own seed: another seed of the campaign draws other noise for the same patient.
        seed=campaign.synthetic.anatomy_seed,
    script:
        "../scripts/bundled_patient.py"


rule case:
    input:
        case=PATIENT,
        named=[file for path in NAMED for file in files_under(path)],
        bundled=BUNDLED if campaign.case == "bundled" else [],
        code=code("coronaryuq.case.stage"),
    output:
        case=results("case", "case.json"),
        tree=results("case", "tree.vtp"),
        network=results("case", "network.json"),
        lv=results("case", "lv.vtu"),
    log:
        log_of("case.log"),
    params:
        settings=block("patient"),
    script:
        "../scripts/case.py"
