"""The prediction before and after adoption, and with the truth."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy import benchmark
from coronaryuq.bench.discrepancy.loop import summary
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.read import write_network
from support.small_loop import loop


@pytest.mark.slow
def test_adoption_brings_the_prediction_to_that_of_the_true_model(tmp_path):
    """One stenosis in a loop of two coronary beds: FFR is off without it, and with it as far as with the truth."""
    write_network(tmp_path / "loop.json", loop())
    options = {"network": str(tmp_path / "loop.json"), "nature": "own", "offset": 1, "effects": ["quadratic_stenosis"]}
    found = benchmark.run(quick=False, loop=True, **options)["loop"]
    assert found["cases"] == found["named_right"] == 1
    assert found["ffr_error_before"] > 3 * found["ffr_error_truth"]
    assert abs(found["ffr_error_after"] - found["ffr_error_truth"]) < 0.2 * found["ffr_error_before"]
    (one,) = found["each"]
    assert found["flow_coverage_90_after"]["trials"] == len(one["after"]["flow"]["error"]) == 2
    assert np.isclose(found["ffr_error_after"], np.sqrt(np.mean(np.square(one["after"]["ffr"]["error"]))))


def test_a_case_that_fails_is_counted_and_the_rest_is_scored():
    scored = {"truth": [0.8], "median": [0.82], "error": [0.02], "inside": [True]}
    good = {"effect": "a", "seed": 1, "named_right": True}
    good |= {when: {"ffr": scored, "flow": scored, "failed_draws": 0} for when in ("before", "after", "truth")}
    found = summary([good, {"effect": "a", "seed": 2, "failed": "20 of 200 draws do not run"}])
    assert (found["cases"], found["failed"], found["named_right"]) == (2, 1, 1)
    assert found["ffr_error_after"] == pytest.approx(0.02) and len(found["each"]) == 2
    assert summary([{"effect": "a", "seed": 2, "failed": "none runs"}])["failed"] == 1


def test_predictions_are_compared_case_by_case_with_those_of_the_truth_and_those_before():
    """Equal to the truth; off by more, but by little; off by much; not named right, and worse than before."""

    def case(before, after, truth, right=True):
        errors = {"before": before, "after": after, "truth": truth}
        scored = {when: {"truth": [0.8], "error": [error], "inside": [True]} for when, error in errors.items()}
        return {"named_right": right} | {when: {"ffr": one, "flow": one} for when, one in scored.items()}

    cases = [case(0.2, -0.021, 0.02), case(0.2, 0.014, 0.01), case(0.2, 0.09, -0.05), case(0.02, 0.03, 0.01, False)]
    found = summary(cases)
    assert (found["named_right"], found["as_truth"], found["as_truth_or_small"], found["worse"]) == (3, 1, 2, 1)


@pytest.mark.slow
def test_a_killed_run_of_predictions_goes_on(tmp_path, monkeypatch):
    write_network(tmp_path / "loop.json", loop())
    options = {"network": str(tmp_path / "loop.json"), "nature": "own", "loop": True, "effects": ["quadratic_stenosis"]}
    asked = []

    def prediction(experiment, nature, name, seed, threads):
        asked.append(seed)
        return {"effect": name, "seed": seed, "failed": "not run"}

    monkeypatch.setattr(benchmark, "prediction", prediction)
    for seeds in (1, 2):
        benchmark.run(quick=False, seeds=seeds, resume=tmp_path / "cases.jsonl", **options)
    assert asked == [100, 101]


@pytest.mark.parametrize("options", [{}, {"network": "loop.json", "solver": "3d"}])
def test_it_needs_a_tuned_closed_loop(options):
    with pytest.raises(InputError, match="--network, a tuned closed loop"):
        benchmark.run(quick=False, loop=True, **options)
