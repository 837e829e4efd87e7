"""The prediction before and after adoption, and with the truth."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy import benchmark
from coronaryuq.bench.discrepancy.loop import summary
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.read import write_network
from support.small_loop import loop


@pytest.mark.long
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
    """As good as the truth; worse, twice; better; not named right, and worse than before."""
    seeds = iter(range(9))

    def case(before, after, truth, right=True):
        errors = {"before": before, "after": after, "truth": truth}
        scored = {when: {"truth": [0.8], "error": [error], "inside": [True]} for when, error in errors.items()}
        of_models = {when: {"ffr": one, "flow": one} for when, one in scored.items()}
        return {"named_right": right, "seed": next(seeds)} | of_models

    cases = [case(0.2, -0.021, 0.02), case(0.2, 0.014, 0.01), case(0.2, 0.09, -0.05), case(0.2, 0.01, 0.02)]
    cases.append(case(0.02, 0.03, 0.01, False))
    found = summary(cases)
    assert (found["named_right"], found["as_truth"], found["truth_as_adopted"], found["worse"]) == (4, 2, 3, 1)
    ratio = found["error_over_truth"]
    assert ratio["ratio"] == pytest.approx(np.sqrt((0.021**2 + 0.014**2 + 0.09**2 + 0.01**2) / (0.0034)))
    assert ratio["low"] < ratio["ratio"] < ratio["high"]
    assert set(summary(cases[:1])["error_over_truth"]) == {"ratio"}, "one seed has no interval"


def test_the_interval_of_the_ratio_of_errors_holds_one_for_equally_good_models():
    """By trial: within three standard errors of 95 % of 400, and one more per cent, as the interval is linearised."""
    random, held = np.random.default_rng(5), 0
    for _ in range(400):
        errors = 0.02 * random.standard_normal((20, 2, 2))
        cases = [
            {"seed": seed, "named_right": True}
            | {
                when: {kind: {"error": list(of), "inside": [True, True]} for kind in ("ffr", "flow")}
                for when, of in {"before": own[0], "after": own[0], "truth": own[1]}.items()
            }
            for seed, own in enumerate(errors)
        ]
        ratio = summary(cases)["error_over_truth"]
        held += ratio["low"] <= 1.0 <= ratio["high"]
    assert abs(held / 400 - 0.95) < 0.01 + 3 * np.sqrt(0.95 * 0.05 / 400)


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
