"""The runner of stage functions: keywords of a call, and that every rule gives its function what it takes."""

import json
import pickle
import subprocess
import sys

import pytest

from coronaryuq.campaign.job import job
from coronaryuq.core.ranks import Ranks
from support.checkout import EMPTY_OUTPUTS, ROOT, Checkout

pytestmark = pytest.mark.workflow

KEEPS_JOB = (
    EMPTY_OUTPUTS
    + """
import pickle, uuid
with open(f"job_{uuid.uuid4()}", "wb") as file:
    pickle.dump((rule, globals().get("snakemake"), sys.argv), file)
"""
)


def test_every_rule_gives_its_function_what_it_takes(tmp_path, monkeypatch):
    """The campaign's jobs only keep what they were given; their functions are then looked up in one process."""
    checkout = Checkout(tmp_path)
    (checkout.folder / "workflow" / "scripts" / "stage.py").write_text(KEEPS_JOB)
    checkout.settings |= {"discrepancy": {"in_report": True, "adopt": True}, "losses": {"runs_3d": 8}}
    done = checkout.run()
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Ranks, "started", lambda size, threads: Ranks(threads=threads))
    rules = set()
    for path in sorted(tmp_path.glob("job_*")):
        rule, snakemake, words = pickle.loads(path.read_bytes())
        monkeypatch.setattr(sys, "argv", words)
        with job({} if snakemake is None else {"snakemake": snakemake}) as this:
            this.arguments(this.function())
        rules.add(rule.split()[0])
    assert {"posterior_chains", "estimation", "discrepancy_search", "adoption_prediction", "losses"} <= rules


@pytest.fixture
def run(tmp_path):
    """Run stage.py by hand on a function of a module in the temporary folder."""
    (tmp_path / "some_stage.py").write_text(
        "from pathlib import Path\n"
        "from coronaryuq.perfusion.settings import Settings\n\n"
        "def act(text_txt: str, settings: Settings, out_dir: Path, parts_folder: Path, seed: int, threads: int = 1):\n"
        "    print(type(settings).__name__, out_dir.name, parts_folder.name, seed, threads)\n"
        "    Path(out_dir, 'out.txt').write_text(text_txt)\n"
    )

    def call(made="made", environment=(), **params):
        files = ["--input", "text_txt=a.txt", "parts=b/1.txt", "parts=b/2.txt", "--output", f"whole={made}/out.txt"]
        (tmp_path / made).mkdir(exist_ok=True, parents=True)
        command = [sys.executable, str(ROOT / "workflow" / "scripts" / "stage.py"), *files, "--threads", "2"]
        command += ["--params", json.dumps({"function": "some_stage:act", **params})]
        own = {"PYTHONPATH": f"{tmp_path}:{ROOT / 'src'}", "PATH": "", **dict(environment)}
        return subprocess.run(command, cwd=tmp_path, env=own, capture_output=True, text=True)

    return call


def test_a_function_gets_settings_paths_and_threads(run, tmp_path):
    done = run(settings={"realisations": 7}, seed=3)
    assert done.returncode == 0, done.stderr
    assert "Settings made b 3 2" in done.stderr and done.stdout == ""
    assert (tmp_path / "made" / "out.txt").read_text() == "a.txt"


@pytest.mark.parametrize(
    ("params", "error"),
    [
        ({"settings": {}}, "missing a required argument: 'seed'"),
        ({"settings": {}, "seed": 1, "sead": 2}, "unexpected keyword argument 'sead'"),
        ({"settings": {}, "seed": 1, "text_txt": "b.txt"}, "named twice in its rule: text_txt"),
    ],
)
def test_a_rule_that_does_not_fit_its_function_is_refused(run, params, error):
    done = run(**params)
    assert done.returncode == 1 and error in done.stderr


def test_a_job_within_a_step_of_srun_leaves_its_note(run, tmp_path):
    """Two patients in one srun: the second's jobs are no second ranks."""
    for name in ("a.txt", "b/1.txt", "b/2.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    outer = {"SLURM_PROCID": "1", "PMI_RANK": "1", "PMI_SIZE": "2", "PMIX_RANK": "1", "SLURM_STEP_NUM_TASKS": "2"}
    done = run("results/x/made", outer, settings={}, seed=1)
    assert done.returncode == 0, done.stderr
    (note,) = (tmp_path / "results/x/provenance").glob("*.json")
    assert json.loads(note.read_text())["resources"]["mpi_ranks"] == 1
