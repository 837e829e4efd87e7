"""The search of a case from files: an answer that agrees with what was hidden, or one line for invalid input."""

import json

import numpy as np
import pandas as pd
import pytest
import yaml

from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import hide
from coronaryuq.cli import discrepancy as command
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.discrepancy import search_case
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.result import write
from coronaryuq.discrepancy.settings import Settings
from support.discrepancy_command import arguments, case_arguments
from support.hypotheses import assume


@pytest.mark.slow
def test_a_stenosis_case_is_named_located_and_repaired(stenosis_case, tmp_path, capsys):
    folder, truth = stenosis_case
    assert command.main(case_arguments(folder, tmp_path)) == 0
    text = capsys.readouterr()
    assert (
        "\nbest: quadratic_stenosis at " in text.err and "checking each effect by all data" in text.err.splitlines()[-2]
    )
    answer = json.loads(text.out)
    one, place = truth.hypothesis.effects[0]
    assert answer["alarm"] and not answer["outside_library"]
    assert (one.name, place) in [(m["effect"], m["place"]) for m in answer["named"][0]["class"]]
    assert answer["gap_after"] < answer["gap_before"]
    assert answer["gap_after"] == pytest.approx(1.0, abs=0.2)
    expected = (
        "repaired.json",
        "conditions.yaml",
        "difference.txt",
        "ranking.csv",
        "residuals.csv",
        "measurements.csv",
    )
    assert all((tmp_path / name).exists() for name in expected)
    named = answer["named"][0]
    tree = pd.read_csv(tmp_path / "tree.csv").set_index("vessel").named.dropna()
    assert dict(tree) == {named["place"]: f"{named['effect']} at {named['place']}"}


@pytest.mark.slow
def test_no_hidden_effect_leaves_nothing_to_explain(tmp_path, capsys):
    hide(Case((), "none", "nominal", 6), open_loop(), tmp_path)
    command.main(case_arguments(tmp_path, tmp_path / "out"))
    text = capsys.readouterr()
    assert "; nothing to explain (global test p = " in text.err and "nearest" not in text.err
    answer = json.loads(text.out)
    assert not answer["alarm"] and answer["named"] == []
    assert "nothing to explain" in answer["paragraph"]
    detectable = pd.read_csv(tmp_path / "out" / "detectable.csv").set_index(["effect", "place"])
    seen = detectable[detectable.signal >= answer["detectable"]["signal"]].reset_index().effect
    shown = answer["detectable"]["effects"]
    assert set(shown) <= set(seen) and "quadratic_stenosis" in shown
    assert f"these data would show {len(shown)} of the {answer['detectable']['of']} kinds" in answer["paragraph"]


@pytest.mark.slow
def test_overstated_standard_deviations_raise_a_warning(stenosis_case, tmp_path, capsys):
    """They may be in another unit than the values, and would hide the stenosis."""
    for name in ("model.json", "conditions.yaml"):
        (tmp_path / name).write_text((stenosis_case[0] / name).read_text())
    table = pd.read_csv(stenosis_case[0] / "measurements.csv")
    table.assign(sd=100.0 * table.sd).to_csv(tmp_path / "measurements.csv", index=False)
    command.main(case_arguments(tmp_path, tmp_path / "out"))
    message = capsys.readouterr().out
    assert "nothing to explain" in message and "check that these are correct and in the unit of the values" in message


@pytest.mark.long
def test_names_without_a_held_out_condition_are_called_untested(stenosis_case, tmp_path, capsys):
    for name in ("model.json", "measurements.csv"):
        (tmp_path / name).write_text((stenosis_case[0] / name).read_text())
    conditions = yaml.safe_load((stenosis_case[0] / "conditions.yaml").read_text())
    for entry in conditions.values():
        (entry or {}).pop("held_out", None)
    (tmp_path / "conditions.yaml").write_text(yaml.safe_dump(conditions, sort_keys=False))
    command.main(case_arguments(tmp_path, tmp_path / "out"))
    message = capsys.readouterr().out
    assert "The best explanation is quadratic stenosis" in message and "hold a condition out" in message


@pytest.mark.slow
def test_one_condition_is_searched_without_a_claim_of_held_out_success(stenosis_case, tmp_path, capsys):
    """A pulse has many flows: even the law of a loss is seen under one condition."""
    for name in ("model.json", "conditions.yaml"):
        (tmp_path / name).write_text((stenosis_case[0] / name).read_text())
    table = pd.read_csv(stenosis_case[0] / "measurements.csv")
    table[table.condition == "hyperaemia"].to_csv(tmp_path / "measurements.csv", index=False)
    command.main(case_arguments(tmp_path, tmp_path / "out"))
    message = capsys.readouterr().out
    assert "each series, held out in turn," in message and "measure another condition and hold it out" in message
    answer = json.loads((tmp_path / "out" / "discrepancy.json").read_text())
    members = {(member["effect"], member["place"]) for member in answer["named"][0]["class"]}
    (true,) = stenosis_case[1].hypothesis
    assert true.key in members
    assert answer["held_out"]["scheme"] == "each series in turn"


@pytest.mark.long
def test_a_size_outside_its_prior_is_named_with_a_doubt(stenosis_case, tmp_path, capsys):
    """A sensor error of four prior standard deviations is named with a doubt, one within its prior without."""
    acting = assume(("pressure_offset", "lad:BC_lad"))
    make_case.hide(open_loop(), acting, np.array([4.0]), make_case.Noise(), 3, tmp_path)
    for folder, beyond in ((tmp_path, ["offset"]), (stenosis_case[0], [])):
        command.main(case_arguments(folder, tmp_path / "out"))
        answer = json.loads(capsys.readouterr().out)
        assert [one["beyond_prior"] for one in answer["named"]] == [beyond]
        assert ("outside the central 99 %" in answer["paragraph"]) == bool(beyond)


@pytest.mark.long
def test_a_repaired_case_leaves_nothing_to_explain(stenosis_case, tmp_path, capsys):
    """The files of a result are searched again unchanged."""
    command.main(case_arguments(stenosis_case[0], tmp_path / "out"))
    files_of = [tmp_path / "out" / name for name in ("repaired.json", "measurements.csv", "conditions.yaml")]
    words = zip(("--model", "--measurements", "--conditions"), files_of, strict=True)
    command.main(arguments(*(word for pair in words for word in pair), "--out", tmp_path / "again", "--json"))
    answer = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert not answer["alarm"] and answer["gap_before"] == pytest.approx(1.0, abs=0.2)


def test_a_model_that_does_not_run_is_rejected(stenosis_case, tmp_path, monkeypatch):
    """This model runs under any condition, so the failure is simulated."""

    def stopped(problem, seed, report):
        raise FloatingPointError("the model could not be run")

    monkeypatch.setattr(search_case, "discover", stopped)
    paths = [stenosis_case[0] / name for name in ("model.json", "measurements.csv", "conditions.yaml")]
    with pytest.raises(
        InputError, match="conditions.yaml: the model does not run under any condition after recalibration"
    ):
        search_case.search_case(*paths, tmp_path / "out", Settings(), 1)
    assert not (tmp_path / "out").exists()


def test_a_condition_without_measurements_is_told(stenosis_case, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(search_case, "discover", lambda problem, seed, report: problem)
    conditions = tmp_path / "conditions.yaml"
    conditions.write_text((stenosis_case[0] / "conditions.yaml").read_text() + "\nexercise: {period_scale: 0.6}\n")
    paths = [stenosis_case[0] / name for name in ("model.json", "measurements.csv")]
    search_case.searched(*paths, conditions, Settings(), 1)
    said = capsys.readouterr().err
    assert f"note: {conditions}: exercise: no measurements of this condition; it is not used" in said


def test_a_network_without_vessels_is_rejected(stenosis_case, tmp_path):
    """A block coupled to another solver runs, but has no places for effects."""
    folder = stenosis_case[0]
    empty = {"vessels": [], "junctions": [], "boundary_conditions": []}
    write_json(tmp_path / "model.json", json.loads((folder / "model.json").read_text()) | empty)
    with pytest.raises(InputError, match="model.json: vessels: missing"):
        rest = (folder / "measurements.csv", folder / "conditions.yaml", tmp_path / "out", Settings(), 1)
        search_case.search_case(tmp_path / "model.json", *rest)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_failed_search_keeps_the_earlier_result(stenosis_case, tmp_path, monkeypatch):
    paths = [stenosis_case[0] / name for name in ("model.json", "measurements.csv", "conditions.yaml")]
    search_case.search_case(*paths, tmp_path, Settings(max_effects=0), 1)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.setattr(write, "_tree", lambda found: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        search_case.search_case(*paths, tmp_path, Settings(max_effects=0), 2)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_holding_out_every_condition_is_rejected(stenosis_case, tmp_path):
    folder = stenosis_case[0]
    content = yaml.safe_load((folder / "conditions.yaml").read_text())
    (tmp_path / "c.yaml").write_text(
        yaml.safe_dump({name: {**(keys or {}), "held_out": True} for name, keys in content.items()})
    )
    paths = ("--model", folder / "model.json", "--measurements", folder / "measurements.csv")
    with pytest.raises(InputError, match="fit at least one"):
        command.main(arguments(*paths, "--conditions", tmp_path / "c.yaml", "--out", tmp_path / "out"))
    assert not (tmp_path / "out").exists()
