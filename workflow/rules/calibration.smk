# Calibration: the closed loop tuned to heart, pressures and flow shapes.


rule calibration:
    """Tune the closed loop to the patient's clinical targets."""
    input:
        case_json=rules.case.output.case_json,
        network_json=results("adopted", "network.json") if adopts else untuned,
        targets_json=target_flows,
    output:
        rest_json=results("calibration", "rest.json"),
        hyperaemia_json=results("calibration", "hyperaemia.json"),
        parameters_csv=results("calibration", "parameters.csv"),
        fit_csv=results("calibration", "fit.csv"),
        cost=cost_of("calibration.json"),
    log:
        log_of("calibration.log"),
    cache: cached
    # One thread for each sixteen candidates, which the 0D engine runs at once.
    threads: min(2, -(-campaign.calibration.candidates // 16))
    params:
        **stage("coronaryuq.calibration.stage:tune"),
        settings=block("calibration"),
        seed=campaign.seed,
    script:
        "../scripts/stage.py"
