"""A benchmark that was killed resumes from its finished cases."""

import pytest

from coronaryuq.bench.discrepancy import benchmark
from coronaryuq.bench.discrepancy.benchmark import run
from coronaryuq.core.errors import InputError

SPENT = ("cpu_s", "wall_s")


def answers(found):
    return [{name: value for name, value in case.items() if name not in SPENT} for case in found["cases"]]


@pytest.fixture
def tried(monkeypatch):
    """Labels of the cases that are searched."""
    labels, trial = [], benchmark.trial

    def noted(case, *rest):
        labels.append(case.label)
        return trial(case, *rest)

    monkeypatch.setattr(benchmark, "trial", noted)
    return labels


@pytest.mark.long
def test_finished_cases_are_not_searched_again(tmp_path, tried):
    kept = tmp_path / "finished.jsonl"
    run(quick=True, effects=("none", "quadratic_stenosis"), resume=kept)
    whole = kept.read_text()
    assert tried == ["none", "quadratic_stenosis"] and whole.count("\n") == 3
    # Killed while the second case was being written.
    kept.write_text(whole[: -len(whole.splitlines()[-1]) // 2])
    resumed = run(quick=True, resume=kept)
    assert tried[2:] == ["quadratic_stenosis", "outside:bulging_territory"]
    del tried[:]
    assert answers(resumed) == answers(run(quick=True, resume=kept)), "all taken from the file"
    assert tried == []
    assert answers(resumed) == answers(run(quick=True))
    assert len(tried) == 3


@pytest.mark.slow
@pytest.mark.parametrize("text", ["", "time,flow\n0,1\n", '{"made_by": "x"}\n[1]\n', '{"cases": []}\n', "\xff\n"])
def test_an_unrelated_file_is_rejected_and_kept(tmp_path, text):
    other = tmp_path / "other"
    other.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match="other: no finished cases of this benchmark; choose another file"):
        run(quick=True, effects=("none",), resume=other)
    assert other.read_bytes() == text.encode("latin-1")


@pytest.mark.slow
def test_cases_of_other_code_or_another_network_are_discarded(tmp_path, tried):
    kept = tmp_path / "finished.jsonl"
    run(quick=True, effects=("none",), resume=kept)
    run(quick=True, effects=("none",), resume=kept, name="another")
    assert tried == ["none", "none"]
    kept.write_text(kept.read_text().replace('"made_by": "', '"made_by": "0'))
    run(quick=True, effects=("none",), resume=kept, name="another")
    assert tried == ["none"] * 3
