"""The evidence of an answer by importance sampling stands beside that by Laplace's approximation."""

import pytest

from coronaryuq.bench.discrepancy import benchmark
from coronaryuq.bench.discrepancy.benchmark import run
from coronaryuq.bench.discrepancy.evidence import summary

ROW = {"model": "found", "prior": "right", "laplace": -10.0, "sampled": -10.5, "error": 0.1, "k_hat": 0.3}


def entry(named: float, **row) -> dict:
    other = {"nothing": 0.0, "something else": 0.0}
    return {
        "evidence": [ROW | row],
        "probabilities": other | {"names": 1.0},
        "sampled_probabilities": other | {"names": named, "nothing": 1.0 - named},
    }


def test_differences_are_those_of_reliable_integrals_and_all_answers():
    found = summary([entry(0.9), entry(0.4), entry(1.0, k_hat=0.9, sampled=5.0)])
    assert (found["cases"], found["integrals"], found["reliable"], found["changed"]) == (3, 3, 2, 1)
    assert found["nats"] == {"rms": pytest.approx(0.5), "largest": pytest.approx(-0.5)}
    assert found["largest_change"] == pytest.approx(0.6)


def test_finished_cases_of_another_kind_are_not_taken(tmp_path, monkeypatch):
    """Scored cases and their evidence have other entries; each resumes from its own file only."""
    asked = []

    def made(kind, result):
        return lambda case, **options: asked.append(kind) or result

    monkeypatch.setattr(benchmark, "evidence_trial", made("evidence", entry(1.0)))
    monkeypatch.setattr(benchmark, "trial", made("scores", {"effect": "x"}))
    monkeypatch.setattr(benchmark, "score", lambda cases: {})
    for evidence in (True, True, False):
        options = {"effects": ("quadratic_stenosis",), "resume": tmp_path / "cases.jsonl", "nature": "own"}
        benchmark.run(quick=False, evidence=evidence, **options)
    assert asked == ["evidence", "scores"]


@pytest.mark.long
def test_laplace_and_sampling_agree_on_a_stenosis():
    """Where the search names the effect, by the sampling's own error and what its evidence differs by."""
    found = run(quick=False, effects=("quadratic_stenosis",), evidence=True)
    (case,) = found["cases"]
    for row in case["evidence"]:
        if row["model"] == "found":
            assert row["k_hat"] < 0.7 and abs(row["sampled"] - row["laplace"]) < 0.5 + 4.5 * row["error"]
    assert abs(case["probabilities"]["names"] - case["sampled_probabilities"]["names"]) < 0.02
