"""Several models: weights against closed forms, claims against repeated trials, a coarse mesh as a model."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.campaign.analysis import analyse
from coronaryuq.estimation.estimators.blue import Group, blue, blue_variance
from coronaryuq.estimation.estimators.montecarlo import mfmc_variance
from coronaryuq.estimation.estimators.multilevel import acv_variance, blue_weights, estimate
from coronaryuq.estimation.runs.table import read_rows, read_runs
from coronaryuq.estimation.settings import Settings

# A 3D model, its coarse mesh, two 0D outputs.
COVARIANCE = np.array([[4.0, 3.6, 1.8, 0.6], [3.6, 4.0, 1.7, 0.5], [1.8, 1.7, 1.0, 0.1], [0.6, 0.5, 0.1, 1.0]])
COUNTS = [((0, 1, 2, 3), 40), ((1, 2, 3), 160), ((2, 3), 1000)]


def test_weights_give_the_estimate_of_the_normal_equations_and_its_variance():
    rng = generator(6, "weights")
    groups = [Group(m, rng.normal(size=(n, len(m)))) for m, n in COUNTS]
    weights = blue_weights(COUNTS, COVARIANCE)
    mean = sum(g.outputs.mean(axis=0) @ w for g, w in zip(groups, weights, strict=True))
    assert mean == pytest.approx(blue(groups, COVARIANCE)[0][0])
    spread = sum(w @ COVARIANCE[np.ix_(m, m)] @ w / n for (m, n), w in zip(COUNTS, weights, strict=True))
    assert spread == pytest.approx(blue_variance(dict(COUNTS), COVARIANCE))
    total = np.zeros(4)
    for (models, _), w in zip(COUNTS, weights, strict=True):
        total[list(models)] += w
    np.testing.assert_allclose(total, [1, 0, 0, 0], atol=1e-12)


def test_approximate_control_variates_with_one_model_are_mfmc_and_never_beat_blue():
    rho = COVARIANCE[0, 1] / 4
    assert acv_variance(COVARIANCE[:2, :2], 40, [5]) == pytest.approx(mfmc_variance(4, rho, 40, 200))
    nested = {(0, 1, 2, 3): 40, (1, 2, 3): 160, (2, 3): 1000}
    best = blue_variance(nested, COVARIANCE)
    assert best <= acv_variance(COVARIANCE, 40, [5, 30, 30]) < acv_variance(COVARIANCE[:2, :2], 40, [5]) < 4 / 40


def test_approximate_control_variate_variance_is_the_variance_seen():
    """Nested runs, optimal coefficients; tolerance is five standard errors of a variance of 4000 trials."""
    n, ratios, root = 20, (4, 10), np.linalg.cholesky(COVARIANCE[:3, :3])
    least = np.minimum.outer(ratios, ratios)
    f = (least - 1) / least
    alpha = np.linalg.solve(COVARIANCE[1:3, 1:3] * f, np.diag(f) * COVARIANCE[0, 1:3])
    means = np.empty(4000)
    for t in range(len(means)):
        z = generator(6, "acv", t).normal(size=(n * ratios[-1], 3)) @ root.T
        off = [z[:n, j].mean() - z[: n * r, j].mean() for j, r in zip((1, 2), ratios, strict=True)]
        means[t] = z[:n, 0].mean() - alpha @ off
    claimed = acv_variance(COVARIANCE[:3, :3], n, ratios)
    assert means.var() == pytest.approx(claimed, rel=5 * np.sqrt(2 / len(means)))


@pytest.mark.parametrize("n", [25, 50])
def test_cross_fitted_claims_hold_and_approach_the_closed_form(n):
    """Skewed models with means far from zero; 400 trials, bounds 15 % and three binomial standard errors."""
    root, trials = np.linalg.cholesky(COVARIANCE), 400
    error, claim, holds = np.empty(trials), np.empty(trials), np.empty(trials, bool)
    counts = [((0, 1, 2, 3), n), ((1, 2, 3), 4 * n), ((2, 3), 1000)]
    for t in range(trials):
        rng = generator(6, "blue", n, t)
        groups = [Group(m, (10 + (rng.gamma(4, 0.5, (k, 4)) - 2) @ root.T)[:, list(m)]) for m, k in counts]
        got = estimate(groups, 10, t)
        error[t], claim[t], holds[t] = got.mean - 10, got.std**2, got.interval.holds(10)
    assert np.sqrt(claim.mean()) / error.std() == pytest.approx(1, abs=0.15)
    assert holds.mean() >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / trials)
    assert abs(error.mean()) < 4 * error.std() / np.sqrt(trials)
    assert claim.mean() < 1.3 * blue_variance(dict(counts), COVARIANCE)


@pytest.fixture
def with_coarse(folder):
    """The small campaign with a coarse level: its pilot and 120 inputs more."""
    rng = generator(7, "coarse")
    names = ["BC_lca1", "R_cor_scaling"]
    beyond = pd.DataFrame(rng.uniform(0.5, 2, (120, 2)), columns=names)
    beyond.insert(0, "sample", [f"sample_{i:04d}" for i in range(40, 160)])
    beyond.to_csv(folder / "params_coarse.csv", index=False)
    low = {"mean_flow:lca1:BC_lca1": 1 / beyond["BC_lca1"], "ffr_lad": 1 - 0.2 / beyond["R_cor_scaling"]}
    pd.DataFrame({"sample": beyond["sample"], **low}).to_csv(folder / "outputs_0d_coarse.csv", index=False)
    lines = pd.concat([pd.read_csv(folder / "params.csv"), beyond])
    lines = lines.assign(osi=np.sin(lines["BC_lca1"]) + 0.02 * lines["R_cor_scaling"])
    lines[["sample", "osi"]].to_csv(folder / "outputs_3d_coarse.csv", index=False)
    return folder


def test_a_coarse_mesh_is_one_more_model_of_the_campaign(with_coarse):
    """Coarse outputs at the pilot's and further samples: estimators of their own."""
    folder = with_coarse
    runs, settings = read_runs(folder), Settings(autoencoder=False)
    (row,) = analyse(runs, read_rows(folder / "rows.csv"), settings, 3, beyond_mean=False)
    made = row["estimators"]
    assert made["BLUE"]["std"] < made["MFMC"]["std"] and made["BLUE"]["rho_held_out"] > 0.99
    assert made["BLUE"]["residual_variance"] < 0.5 * made["MFMC"]["residual_variance"]
    assert made["BLUE"]["calibrated"]["low"] < (np.cos(0.5) - np.cos(2)) / 1.5 < made["BLUE"]["calibrated"]["high"]
    assert made["BLUE"]["warnings"] == [] and row["recommended"] in ("BLUE", "best", "multilevel")
    assert made["multilevel"]["std"] < made["MFMC"]["std"]
    assert row["levels"]["fine"] < row["levels"]["cheap"], "the coarse run tells most of the fine one"


def test_a_coarse_run_that_failed_leaves_the_pilot_whole(with_coarse):
    lines = pd.read_csv(with_coarse / "outputs_3d_coarse.csv")
    lines.drop(index=[3, 100]).to_csv(with_coarse / "outputs_3d_coarse.csv", index=False)
    runs = read_runs(with_coarse)
    assert len(runs) == 40 and runs.coarse["osi"].isna().to_numpy().nonzero()[0].tolist() == [3, 100]
    (row,) = analyse(runs, read_rows(with_coarse / "rows.csv"), Settings(autoencoder=False), 3, beyond_mean=False)
    assert "multilevel" in row["estimators"] and "BLUE" not in row["estimators"]
    cut = runs.pilot(np.arange(2, 6))
    assert len(cut.coarse) == 4 + 120 and np.isnan(cut.coarse["osi"][1]) and len(cut.theta_coarse) == 120


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("outputs_3d_coarse.csv", "sample,osi\nnobody,0.1\n", "nobody"),
        ("outputs_3d_coarse.csv", "sample,ffr\nsample_0000,0.1\n", "ffr.*no such column in outputs_3d.csv"),
        ("params_coarse.csv", "sample,BC_lca1\nsample_0040,1.0\n", "R_cor_scaling"),
        ("params_coarse.csv", "sample,BC_lca1,R_cor_scaling\nsample_0001,1.0,1.0\n", "sample_0040"),
        ("outputs_0d_coarse.csv", "sample,ffr_lad\nsample_0040,0.9\n", "mean_flow:lca1:BC_lca1 of sample_0040"),
    ],
)
def test_tables_of_the_coarse_level_that_do_not_fit_are_refused(with_coarse, file, text, said):
    (with_coarse / file).write_text(text)
    with pytest.raises(InputError, match=said):
        read_runs(with_coarse)
