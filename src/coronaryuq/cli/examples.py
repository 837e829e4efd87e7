"""Examples for the help of the commands; they work where the campaign `smoke` has been run."""

LOOP = "results/smoke/calibration/hyperaemia.json"
PUBLISHED = "../shared/data/menon2024"
HIDDEN = "results/smoke/discrepancy/hidden/case"

EXAMPLES: dict[str, list[tuple[str, str]]] = {
    "": [
        ("coronaryuq demo", "every stage once on the bundled patient"),
        ("coronaryuq check config/smoke.yaml", "check a configuration before its campaign is run"),
        ("coronaryuq explain results/smoke/estimation/table.csv", "show where a result comes from"),
        ("coronaryuq solve --help", "show the options of one command"),
    ],
    "init": [
        ("coronaryuq init results/smoke/patient/tree.vtp --into mine", "asks for what is not clear on a terminal"),
        (
            "coronaryuq init results/smoke/patient/tree.vtp --perfusion results/smoke/patient/lv.vtu --yes",
            "in tree-case, without questions",
        ),
    ],
    "run": [
        ("coronaryuq run laptop", "the bundled patient, in results/laptop"),
        ("coronaryuq run config/smoke.yaml --dry-run", "show what would run"),
        ("coronaryuq run smoke figures --cores 2", "redraw the figures"),
        ("coronaryuq run paper --profile slurm", "on a cluster, with workflow/profiles/slurm"),
        ("coronaryuq run smoke --dry-run -- --until posterior", "options after -- are passed to snakemake"),
    ],
    "status": [("coronaryuq status results/smoke", "also while it runs, or after it was killed")],
    "compare": [
        ("coronaryuq compare results/smoke results/mine", "FFR lesion by lesion, and the settings that differ")
    ],
    "demo": [("coronaryuq demo", "results/smoke/report.html, in about three minutes")],
    "completion": [("coronaryuq completion bash", 'in ~/.bashrc, as eval "$(coronaryuq completion bash)"')],
    "check": [
        ("coronaryuq check results/smoke/patient/case.yaml", "a case, and all files that it refers to"),
        ("coronaryuq check results/smoke/patient/case.yaml --picture tree.svg", "draw the vessels there"),
        ("coronaryuq check config/smoke.yaml", "a configuration, and the case that it refers to"),
        ("coronaryuq check config/smoke.yaml --json", "the same as JSON, for scripts"),
    ],
    "explain": [
        (
            "coronaryuq explain results/smoke/estimation/table.csv",
            "the code, settings, inputs and machine that produced it",
        ),
        ("coronaryuq explain results/smoke/report.html --json", "the same as JSON, for scripts"),
    ],
    "verify": [
        ("coronaryuq verify results/smoke", "list results that have changed since their jobs wrote them"),
        ("coronaryuq verify results/smoke --remove", "delete them as well, so that they are regenerated"),
    ],
    "crate": [
        ("coronaryuq crate results/smoke", "writes smoke.crate.zip"),
        ("coronaryuq crate results/smoke --out smoke-crate", "writes a folder"),
        ('coronaryuq crate results/smoke --no-data --agent "Ada Example"', "provenance only, without the data"),
    ],
    "doctor": [
        ("coronaryuq doctor", "check everything that a campaign needs on this machine"),
        ("coronaryuq doctor --environment --json", "only the Python environment, as JSON"),
    ],
    "bench": [("coronaryuq bench zerod --quick", "speed of the 0D solver, in less than a minute")],
    "bench zerod": [("coronaryuq bench zerod --quick", "less than a minute")],
    "bench conformance": [("coronaryuq bench conformance --cases tests/cases", "cases of svZeroDSolver's repository")],
    "bench trees": [("coronaryuq bench trees --quick", "less than a minute")],
    "bench perfusion": [("coronaryuq bench perfusion --quick", "less than a minute")],
    "bench dream": [("coronaryuq bench dream --quick", "less than a minute")],
    "bench flow3d": [("coronaryuq bench flow3d --quick", "less than a minute")],
    "bench table": [(f"coronaryuq bench table --quick --data {PUBLISHED}", "needs the published runs")],
    "bench scale": [(f"coronaryuq bench scale --quick --data {PUBLISHED}", "needs the published runs")],
    "bench coverage": [("coronaryuq bench coverage --quick", "analytic pairs only")],
    "bench models": [("coronaryuq bench models --quick", "analytic pairs only; with PyApprox if it is installed")],
    "bench discrepancy": [
        ("coronaryuq bench discrepancy --quick --seeds 1", "one hidden case per cell"),
        ("coronaryuq bench discrepancy --quick --rivals", "the same cases, answered by other methods"),
    ],
    "bench endtoend": [
        ("coronaryuq bench endtoend --quick", "the truth of one patient, with 0D beside it: less than a minute"),
        (
            "coronaryuq bench endtoend --patients 100 --resume patients.jsonl",
            "some ten minutes a patient; goes on if killed",
        ),
        ("coronaryuq bench endtoend --patients 1 --noise 0", "the data are the truth"),
    ],
    "bench campaign": [("coronaryuq bench campaign --quick", "up to the perfusion targets")],
    "solve": [(f"coronaryuq solve {LOOP} flows.csv", "the tuned loop of a campaign, as svZeroDSolver's table")],
    "tune": [
        (
            "coronaryuq tune results/smoke/calibration/rest.json results/smoke/patient/targets.csv --out tuned",
            "retune a loop; takes minutes on a laptop",
        )
    ],
    "fit": [
        (
            f"printf 'name,flow\\nlca1,3\\nlca2,2\\n' > ratio.csv && coronaryuq fit {LOOP} ratio.csv --out fitted",
            "divide the flow of two beds in the ratio 3 to 2",
        )
    ],
    "discrepancy": [
        (
            f"coronaryuq discrepancy --model {HIDDEN}/model.json --measurements {HIDDEN}/measurements.csv "
            f"--conditions {HIDDEN}/conditions.yaml --out found",
            "after `snakemake discrepancy --configfile config/smoke.yaml`, which hides an effect; takes minutes",
        ),
        (
            f"coronaryuq discrepancy --pairs {PUBLISHED}/outputs_0d.csv {PUBLISHED}/outputs_3d.csv --out pairs",
            "effects of the published 3D runs that the 0D runs lack, from tables alone",
        ),
    ],
    "serve": [
        ("coronaryuq serve results/smoke", "at http://127.0.0.1:4242, for clients on this machine"),
        ("coronaryuq serve results/smoke --port 0", "at a free port, which is printed"),
    ],
}
"""Command → pairs of a command line and a comment."""
