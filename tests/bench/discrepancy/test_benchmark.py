"""A benchmark that was killed resumes from its finished cases."""

import pytest

from coronaryuq.bench.discrepancy import benchmark
from coronaryuq.bench.discrepancy.benchmark import NATURE, run
from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import closed_loop, open_loop
from coronaryuq.bench.discrepancy.trial import hide, trial
from coronaryuq.core.errors import InputError
from support.small_loop import loop

SPENT = ("cpu_s", "cpu_s_made", "wall_s")


def answers(found):
    return [{name: value for name, value in case.items() if name not in SPENT} for case in found["cases"]]


@pytest.fixture
def tried(monkeypatch):
    """Labels of the cases that are searched."""
    labels, trial = [], benchmark.trial

    def noted(case, **rest):
        labels.append(case.label)
        return trial(case, **rest)

    monkeypatch.setattr(benchmark, "trial", noted)
    return labels


def test_a_case_that_the_search_refuses_as_mistyped_is_skipped_with_the_reason():
    """A coronary flow probe reads the aorta's flow, fifty times as large."""
    misplaced = Case(("misplaced_flow",), "medium", "nominal", 20010)
    found = trial(misplaced, closed_loop(loop()), NATURE)
    assert found is not None and found["skipped"] and "ratio to the largest simulated value" in found["refused"]


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


@pytest.mark.long
def test_cases_of_other_code_or_another_network_are_discarded(tmp_path, tried):
    kept = tmp_path / "finished.jsonl"
    run(quick=True, effects=("none",), resume=kept)
    run(quick=True, effects=("none",), resume=kept, name="another")
    assert tried == ["none", "none"]
    kept.write_text(kept.read_text().replace('"made_by": "', '"made_by": "0'))
    run(quick=True, effects=("none",), resume=kept, name="another")
    assert tried == ["none"] * 3


@pytest.mark.slow
def test_svzerodsolver_makes_the_data_and_the_result_states_how_far_they_are_off(capsys):
    found = run(quick=True, effects=("none", "quadratic_stenosis"), nature="svzerod", vessels=0.02)
    assert [case["made_by"] for case in found["cases"]] == ["svzerod"] * 2
    assert found["nature"]["program"] == "svzerod" and found["nature"]["vessels"] == 0.02
    assert found["nature"]["each bed"] == 0.15 and found["nature"]["violated"] == {"vessels": 0.15, "each bed": 0.2}
    assert all(case["cpu_s_made"] > 0.0 for case in found["cases"]) and found["cases"][1]["alarmed"]


def test_where_svzerodsolver_is_missing_our_engine_makes_the_data(monkeypatch, capsys):
    monkeypatch.setattr(benchmark, "installed", lambda: None)
    assert benchmark.Options(quick=True).drawn().program == "own"
    assert capsys.readouterr().err == "svZeroDSolver is not installed: the data are made by our engine\n"
    with pytest.raises(InputError, match="--nature = 'svzerod': pip install svzerod, or use own"):
        benchmark.Options(quick=True, nature="svzerod").drawn()


@pytest.mark.long
def test_a_size_is_scaled_until_it_leaves_the_wanted_trace(tmp_path):
    for number, name in enumerate(("flow_gain", "diffuse_narrowing")):
        case = Case((name,), "trace 20", "nominal", 5)
        folder = tmp_path / str(number)
        folder.mkdir()
        truth, _ = hide(case, open_loop(), folder)
        assert truth.visible == pytest.approx(20.0, rel=0.05) and abs(truth.sizes[0]) <= 3.0
    faint = Case(("flow_gain",), "trace 1e6", "nominal", 5)
    assert hide(faint, open_loop(), tmp_path) == (None, 6), "no plausible gain has that trace"


@pytest.mark.parametrize("two", [("rivals", "evidence"), ("rivals", "loop"), ("evidence", "loop")])
def test_scores_of_two_kinds_are_not_asked_for_at_once(two):
    with pytest.raises(InputError, match=f"--{two[1]}: not together with --{two[0]}"):
        run(quick=True, **dict.fromkeys(two, True))
