"""5 % of the 3D runs fail: the campaign ends, says which and why, asks whether θ has to do with it, uses the rest.

The runs go through the adapter of svSolver and programs that stand in for it, whose answers are known functions of θ;
so is, exactly, what the estimators estimate.
"""

import numpy as np
import pytest

from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import read_csv
from support import standin
from support.checkout import Checkout

pytestmark = [pytest.mark.workflow, pytest.mark.long]

SETTINGS = {
    "name": "small",
    "backend": "svsolver",
    "samples": {"n_3d": 60, "n_0d": 200, "batch_3d": 20, "chunk_0d": 100, "chunk_realisations": 40},
    "synthetic": {"cells": 3000},
    "perfusion": {"realisations": 40},
    "losses": {"runs_3d": 0},
    "calibration": {"candidates": 4, "starts": 1, "rounds": 1, "evaluations_per_parameter": 2, "final_nelder_mead": 0},
    "posterior": {
        "dream": {"chains": 12, "generations": 400},
        "independence": {"draws": 30},
        "rhat_limit": 9.0,
        "ess_limit": 1,
    },
    "mesh": {
        "throat_resolution": 2.0,
        "jet_resolution": 1.5,
        "resolution": 1.5,
        "core_resolution": 0,
        "wall_grading": 0,
        "axial_stretch": 1,
    },
    "estimation": {"autoencoder": False, "convergence_subsamples": 5, "convergence_sizes": [20, 30, 40]},
}
AT_RANDOM = {"pilot_00007": "diverges", "pilot_00023": "hangs", "pilot_00041": "cut short"}
REASONS = {
    "diverges": "svsolver failed with code 1: Error: residual is NaN at step 17",
    "hangs": "svsolver ran out of time",
    "cut short": "all_results.vtu is truncated",
}
ESTIMATES = "results/small/estimation/table.csv"


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Runs the campaign with given faults; what does not depend on them is computed once."""
    folder = tmp_path_factory.mktemp("failed")
    (folder / "cache").mkdir()

    def run(name: str, faults: dict[str, str], *targets: str):
        checkout = Checkout(folder / name, folder / "cache")
        programs = standin.install(folder / name / "programs", faults)
        few = {"steps_per_cycle": 20, "cycles": 1, "frames_per_cycle": 4, "time_limit": 15.0}
        checkout.settings = SETTINGS | {"flow3d": {"simvascular": programs | few, "mesh_study": 0}}
        done = checkout.run(*targets)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        return folder / name / "results" / "small"

    return run


@pytest.fixture(scope="module")
def at_random(campaign):
    return campaign("random", AT_RANDOM, ESTIMATES)


def x_of(results, params) -> np.ndarray:
    """x of the stand-in for rows of θ."""
    network = read_json(results / "calibration" / "hyperaemia.json")
    beds = [b["bc_name"] for b in network["boundary_conditions"] if "Ra" in b["bc_values"] or "Ra1" in b["bc_values"]]
    logs = np.log(params[[name for name in params.columns if name in beds]].to_numpy()).sum(axis=1) / len(beds)
    return standin.mean_log_resistance(network) + logs + np.log(params["R_cor_scaling"].to_numpy())


def exactly(results, f) -> float:
    """Mean of f(x) over the law of θ: draws of the posterior, and a scaling uniform within its limits (Gauss rule)."""
    draws = read_csv(results / "posterior" / "draws.csv").assign(R_cor_scaling=1.0)
    low, high = (read_json(results / "runs" / "param_limits.json")[end]["R_cor_scaling"] for end in ("min", "max"))
    nodes, weights = np.polynomial.legendre.leggauss(16)
    scaling = np.log(low + (high - low) * (nodes + 1.0) / 2.0)
    return float(f(x_of(results, draws)[:, None] + scaling).mean(axis=0) @ weights / 2.0)


def rows(results) -> list[dict]:
    return read_json(results / "estimation" / "estimates.json")["rows"]


def check_estimates(results) -> None:
    """Every estimate lies within four of its own standard deviations of what is known exactly."""
    exact = {name: exactly(results, getattr(standin, name)) for name in ("ffr", "tawss", "osi")}
    checked = 0
    for row in rows(results):
        for name, held in row["estimators"].items():
            assert abs(held["mean"] - exact[row["column_3d"].split("_")[0]]) < 4 * held["std"], (row["row"], name)
            checked += 1
    assert checked >= 36


def test_failures_at_random_are_left_out(at_random):
    runs = read_csv(at_random / "runs" / "outputs_3d.csv")
    assert len(runs) == 57 and not set(AT_RANDOM) & set(runs["sample"])
    pilot = read_csv(at_random / "runs" / "params.csv").set_index("sample").loc[runs["sample"]].reset_index()
    assert np.allclose(runs["ffr_lad"], standin.ffr(x_of(at_random, pilot)), rtol=1e-6)
    assert not any("not at random" in warning for row in rows(at_random) for warning in row["warnings"])
    check_estimates(at_random)


def test_failures_that_depend_on_theta_are_listed_reported_and_corrected(at_random, campaign):
    """The three runs with the largest scaling of resistance fail, each in its own way."""
    pilot = read_csv(at_random / "samples" / "pilot.csv")
    faults = dict(zip(pilot.nlargest(3, "R_cor_scaling")["sample"], REASONS, strict=True))
    results = campaign("depending", faults)
    jobs = {path.stem.split("-")[0] for path in (results / "provenance").glob("*.json")}
    assert "flow3d_batch" in jobs and not {"mesh", "posterior_chains"} & jobs, "the rest came from the cache"

    failed = {f["sample"]: f["reason"] for f in read_json(results / "runs" / "failures.json")["flow3d"]["failed"]}
    page = (results / "report.html").read_text()
    assert set(failed) == set(faults)
    for sample, reason in failed.items():
        assert reason.startswith(REASONS[faults[sample]])
        assert sample in page and reason in page

    told = {warning for row in rows(results) for warning in row["warnings"]}
    (line,) = [warning for warning in told if "not at random" in warning]
    assert line.startswith("3 of 60 3D runs failed, not at random: R_cor_scaling differs")
    assert "3 of 60 3D runs failed, not at random" in page
    check_estimates(results)


def test_the_check_of_estimates_can_fail(at_random):
    """Plain means over runs of which θ has taken half miss the exact value by more than the check allows."""
    ffr = np.sort(read_csv(at_random / "runs" / "outputs_3d.csv")["ffr_lad"].to_numpy())
    kept = ffr[: len(ffr) // 2]
    assert abs(kept.mean() - exactly(at_random, standin.ffr)) > 4 * kept.std() / np.sqrt(len(kept))
