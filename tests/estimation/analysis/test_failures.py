"""Failures that depend on θ are found, in one input or in several together, and failures at random are not."""

import math

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.analysis import failures
from support.runs import runs_of

BEDS, SCALING = 14, "R_cor_scaling"
INPUTS = (*(f"bed_{j}" for j in range(BEDS)), SCALING)


def drawn(rng, count: int) -> np.ndarray:
    """θ as in a campaign: beds with a common part, and a uniform scaling."""
    beds = rng.normal(0, 0.15, (count, BEDS)) + rng.normal(0, 0.05, (count, 1))
    return np.column_stack([np.exp(beds), rng.uniform(0.7, 1.25, count)])


def split(theta: np.ndarray, score: np.ndarray, failed: int) -> tuple[np.ndarray, np.ndarray]:
    """The highest scores fail."""
    order = np.argsort(-score)
    return theta[order[:failed]], theta[order[failed:]]


def finding_of(failed: np.ndarray, ended: np.ndarray):
    nothing = {"y": np.zeros(len(ended))}
    runs = runs_of(ended, nothing, nothing, ended, theta_failed=failed, inputs=INPUTS)
    return failures.failed_not_at_random(runs, 1, SCALING)


REASONS = {
    "one input": lambda x: x[:, 3],
    "mean resistance": lambda x: x[:, :BEDS].mean(axis=1),
    "total resistance": lambda x: x[:, :BEDS].mean(axis=1) + x[:, BEDS],
    "half of the beds": lambda x: x[:, :7].sum(axis=1) - x[:, 7:BEDS].sum(axis=1),
}
DIFFERENCES = {
    "one input": "bed_3 differs",
    "mean resistance": "the mean of all inputs but R_cor_scaling differs",
    "total resistance": "R_cor_scaling times the mean of the others differs",
    "half of the beds": "inputs together differ, above all bed_",
}


@pytest.mark.parametrize(("reason", "failed", "count"), [
    ("one input", 3, 60), ("mean resistance", 3, 60), ("total resistance", 3, 60), ("half of the beds", 6, 60),
])  # fmt: skip
def test_failures_of_the_extreme_runs_in_a_direction_are_detected(reason, failed, count):
    theta = drawn(generator(5, "sharp", reason), count)
    finding = finding_of(*split(theta, REASONS[reason](np.log(theta)), failed))
    assert finding.text.startswith(f"{failed} of {count} 3D runs failed, not at random: {DIFFERENCES[reason]}")


def trials(number: int, count: int, failed: int, reason=None, permutations: int = 999) -> np.ndarray:
    """p-values of repeated campaigns; the score that decides holds a reason and as much noise, or noise alone."""
    p = np.empty(number)
    for trial in range(number):
        rng = generator(7, "trial", count, failed, trial)
        theta, noise = drawn(rng, count), rng.normal(size=count)
        known = np.zeros(count) if reason is None else REASONS[reason](np.log(theta))
        score = known / (known.std() or 1.0) + noise
        parts = split(np.log(theta), score, failed)
        p[trial] = failures.dependence(*parts, INPUTS, trial, SCALING, permutations)[0]
    return p


@pytest.mark.slow
@pytest.mark.parametrize(("count", "failed"), [(24, 2), (60, 3), (100, 8)])
def test_false_alarms_have_the_nominal_rate(count, failed):
    """Within three binomial standard errors; a test with ties may fall short of its level, never beyond."""
    p, number = trials(400, count, failed), 400
    for level in (0.01, 0.05, 0.2, 0.5):
        share, error = (p <= level).mean(), math.sqrt(level * (1 - level) / number)
        assert share < level + 3 * error
        if failed > 2:
            assert share > level - 3 * error


@pytest.mark.parametrize("reason", REASONS)
def test_a_noisy_dependence_is_found_in_most_campaigns(reason):
    """Half of the score that decides is noise: 25 failures of 500 are found in at least nine of ten campaigns."""
    assert (trials(20, 500, 25, reason) < failures.SIGNIFICANCE).mean() >= 0.9


def test_one_failure_is_no_evidence_and_many_are_reported():
    theta = drawn(generator(5, "one"), 60)
    assert finding_of(*split(theta, theta[:, 0], 1)) is None
    assert finding_of(*split(theta, generator(5, "noise").normal(size=60), 0)) is None
    many = finding_of(*split(theta, generator(5, "noise").normal(size=60), 9))
    assert many.code == "many failures" and many.text == "9 of 60 3D runs failed (15 %)"


def test_constant_and_identical_inputs_do_no_harm():
    theta = drawn(generator(5, "still"), 60)
    theta[:, 5] = 1.0
    theta[:, 6] = theta[:, 7]
    assert finding_of(*split(theta, theta[:, 3], 3)).text.split(": ")[1].startswith("bed_3 differs")
    assert failures.dependence(np.zeros((2, 15)), np.zeros((9, 15)), INPUTS, 1)[0] == 1.0


def test_the_same_seed_gives_the_same_p():
    theta = drawn(generator(5, "seed"), 60)
    parts = split(np.log(theta), theta[:, 3] + 0.3 * generator(5, "noise").normal(size=60), 4)
    p = [failures.dependence(*parts, INPUTS, seed, SCALING)[0] for seed in (1, 1, 2)]
    assert p[0] == p[1] and p[0] == pytest.approx(p[2], abs=0.01)
