# Stage one: the closed loop tuned to heart, pressures and flow shapes.


rule calibration:
    input:
        case=rules.case.output.case,
        network=rules.case.output.network,
        targets=rules.perfusion.output.targets,
        code=code("coronaryuq.calibration.stage"),
    output:
        rest=results("calibration", "rest.json"),
        hyperaemia=results("calibration", "hyperaemia.json"),
        parameters=results("calibration", "parameters.csv"),
        fit=results("calibration", "fit.csv"),
    log:
        log_of("calibration.log"),
    cache: True
    threads: 2
    params:
        settings=block("calibration"),
        seed=campaign.seed,
    script:
        "../scripts/calibration.py"
