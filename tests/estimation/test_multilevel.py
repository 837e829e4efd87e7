"""Several models: weights against closed forms, claims against repeated trials, a coarse mesh as a model."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.errors import InputError
from coronaryuq.estimation.analysis import analyse
from coronaryuq.estimation.blue import Group, blue, blue_variance
from coronaryuq.estimation.montecarlo import mfmc_variance
from coronaryuq.estimation.multilevel import acv_variance, blue_weights, estimate
from coronaryuq.estimation.runs import read_rows, read_runs
from coronaryuq.estimation.settings import Settings
from coronaryuq.seeds import generator

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


def test_a_coarse_mesh_is_one_more_model_of_the_campaign(folder):
    """Coarse outputs at pilot and propagation samples: an estimator of its own, recommended where it claims least."""
    coarse = pd.read_csv(folder / "params.csv"), pd.read_csv(folder / "params_propagation.csv").iloc[:150]
    lines = pd.concat([f.assign(osi=np.sin(f["BC_lca1"]) + 0.02 * f["R_cor_scaling"]) for f in coarse])
    lines[["sample", "osi"]].to_csv(folder / "outputs_3d_coarse.csv", index=False)
    runs, settings = read_runs(folder), Settings(autoencoder=False)
    (row,) = analyse(runs, read_rows(folder / "rows.csv"), settings, 3, beyond_mean=False)
    made = row["estimators"]
    assert made["BLUE"]["std"] < made["MFMC"]["std"] and made["BLUE"]["rho_held_out"] > 0.99
    assert made["BLUE"]["residual_variance"] < 0.5 * made["MFMC"]["residual_variance"]
    assert made["BLUE"]["calibrated"]["low"] < (np.cos(0.5) - np.cos(2)) / 1.5 < made["BLUE"]["calibrated"]["high"]
    assert made["BLUE"]["warnings"] == [] and row["recommended"] in ("BLUE", "best")


def test_coarse_outputs_of_a_stranger_are_refused(folder):
    (folder / "outputs_3d_coarse.csv").write_text("sample,osi\nnobody,0.1\n")
    with pytest.raises(InputError, match="nobody"):
        read_runs(folder)
