"""From files to an answer: one line for bad input, a plain word where nothing is hidden, a name and a repair else."""

import argparse
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import yaml

from coronaryuq.bench.discrepancy.benchmark import Case, hide
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary, pressures
from coronaryuq.bench.discrepancy.score import wilson
from coronaryuq.cli import main
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json, write_text
from coronaryuq.core.units import MMHG
from coronaryuq.discrepancy import command, search_case
from coronaryuq.discrepancy.data.conditions import Condition, read_conditions, under, write_drive
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.inference.read_problem import read_problem
from coronaryuq.discrepancy.result import write
from coronaryuq.discrepancy.result.repair import repaired_conditions, repaired_network
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.discrepancy.table_model.laws import LAWS, fit_law, predict
from coronaryuq.discrepancy.table_model.search import discover_pairs
from coronaryuq.discrepancy.table_model.tables import Branch, branches, read_pairs
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.read import read_network
from support.hypotheses import assume


def arguments(*words):
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    return parser.parse_args([str(word) for word in words])


def case_arguments(folder, out):
    return arguments(
        *("--model", folder / "model.json", "--measurements", folder / "measurements.csv"),
        *("--conditions", folder / "conditions.yaml", "--out", out, "--json"),
    )


@pytest.fixture(scope="module")
def hidden_stenosis(tmp_path_factory):
    folder = tmp_path_factory.mktemp("case")
    truth, _ = hide(Case(("quadratic_stenosis",), "medium", "nominal", 5), open_loop(), folder)
    return folder, truth


@pytest.fixture
def spoiled(hidden_stenosis, tmp_path, capsys):
    """What the console command says of the case with a changed table: one line, and nothing written."""

    def said(change):
        for name in ("model.json", "conditions.yaml"):
            (tmp_path / name).write_text((hidden_stenosis[0] / name).read_text())
        table = pd.read_csv(hidden_stenosis[0] / "measurements.csv")
        change(table).to_csv(tmp_path / "measurements.csv", index=False)
        paths = ("--model", "model.json", "--measurements", "measurements.csv", "--conditions", "conditions.yaml")
        words = [word if word.startswith("--") else str(tmp_path / word) for word in (*paths, "--out", "out")]
        assert main.main(["discrepancy", *words]) == InputError.EXIT_CODE
        write, line = capsys.readouterr()
        assert not write and not (tmp_path / "out").exists()
        assert line.startswith("error: ") and line.count("\n") == 1
        return line

    return said


def test_unknown_location(spoiled):
    message = spoiled(lambda t: t.assign(location=t.location.replace("lad:BC_lad", "lad:BC_lda")))
    assert "BC_lda" in message and "near: " in message and "lad:BC_lad" in message


def test_wrong_unit(spoiled):
    message = spoiled(lambda t: t.assign(unit=t.unit.replace("mL/s", "mmHg")))
    assert "unit" in message and "'mmHg'" in message and "mL/min" in message


def test_missing_sd(spoiled):
    def change(table):
        table.loc[3, "sd"] = np.nan
        return table

    assert "line 5: sd" in spoiled(change)


def test_the_line_of_a_fault_is_that_of_the_file(spoiled, tmp_path):
    spoiled(lambda t: t.assign(sd=np.where(t.index == 3, -1.0, t.sd)))
    path = tmp_path / "measurements.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(["# mine", lines[0], "", *lines[1:3], "# more", *lines[3:]]) + "\n")
    with pytest.raises(InputError, match=r"line 8: sd = -1\.0"):
        command.main(case_arguments(tmp_path, tmp_path / "out"))


def test_two_columns_of_one_name(spoiled):
    assert "value: two columns of that name; leave one" in spoiled(
        lambda t: t.assign(Value=1.0).rename(columns={"value": "VALUE"})
    )


def test_one_condition_only(spoiled):
    message = spoiled(lambda t: t[t.condition == "rest"])
    assert "one condition only" in message


def test_waveform_that_misses_part_of_the_cycle(spoiled):
    message = spoiled(lambda t: t[~(t.time > 0.5)])
    assert "does not cover the cycle" in message


@pytest.mark.parametrize(("shift", "factor"), [(0.45, 1.0), (-0.2, 1.0), (0.0, 1.0 / 0.85)])
def test_waveform_that_does_not_go_with_the_beat(spoiled, shift, factor):
    """The last has shares of the beat for seconds."""
    message = spoiled(lambda t: t.assign(time=factor * t.time + shift))
    assert "beyond the beat of 0.85 s; count times from its start" in message


def test_a_time_given_twice(spoiled):
    message = spoiled(lambda t: pd.concat([t, t[t.statistic == "waveform"].iloc[[2]]]))
    assert ": time = " in message and "given more than once; keep one row" in message


def test_a_number_that_no_measurement_can_be(spoiled):
    def change(table):
        table.loc[7, "value"] = 1e30
        return table

    message = spoiled(change)
    assert "rest/flow/AORTA:left_main/waveform, t = " in message and "see the number and its unit" in message


@pytest.mark.parametrize(
    ("quantity", "factor", "times"), [("flow", 30.0, "30.4"), ("flow", 1 / 60, "0.01"), ("pressure", 7.5, "7.")]
)
def test_values_in_another_unit_than_they_say(spoiled, quantity, factor, times):
    message = spoiled(lambda t: t.assign(value=np.where(t.quantity == quantity, factor * t.value, t.value)))
    assert f"{quantity}: value = {times}" in message and "see the units of both" in message


def test_flows_that_all_run_the_other_way(spoiled):
    def turned(table):
        return table.assign(value=np.where(table.quantity == "flow", -table.value, table.value))

    message = spoiled(turned)
    assert "flow: value = -" in message and "see their signs" in message


def test_a_ratio_has_no_waveform(spoiled):
    message = spoiled(lambda t: t.assign(**{"quantity": "ratio", "statistic": "min", "unit": "1"}))
    assert "line 2: statistic = 'min'" in message and "want mean" in message


def test_a_network_in_another_unit_than_is_guessed(hidden_stenosis, tmp_path, capsys):
    folder = hidden_stenosis[0]
    network = read_network(folder / "model.json")
    for block in network["boundary_conditions"]:
        for name in ("P", "Pim", "P_v", "Pd"):
            if name in block["bc_values"]:
                block["bc_values"][name] = (np.asarray(block["bc_values"][name]) / 10.0).tolist()
    write_json(tmp_path / "model.json", network)
    words = ["--model", tmp_path / "model.json", "--measurements", folder / "measurements.csv"]
    words += ["--conditions", folder / "conditions.yaml", "--out", tmp_path / "out"]
    assert main.main(["discrepancy", *map(str, words)]) == InputError.EXIT_CODE
    line = capsys.readouterr().err
    assert (
        f"{tmp_path / 'model.json'}: pressure_unit = " in line
        and "if the network is in dyn/cm2" in line
        and line.count("\n") == 1
    )


def test_results_do_not_go_over_the_case(hidden_stenosis, capsys):
    folder = hidden_stenosis[0]
    with pytest.raises(InputError, match=r"would overwrite .*measurements.csv; choose another folder"):
        command.main(case_arguments(folder, folder))


def test_results_do_not_go_over_drives_or_tables_of_pairs(tmp_path):
    write_text(tmp_path / "c.yaml", "rest: {drive: {AORTA: drives/mine.csv}}\n")
    words = ["--model", "m.json", "--measurements", "m.csv", "--conditions", tmp_path / "c.yaml", "--out", tmp_path]
    with pytest.raises(InputError, match=r"would overwrite .*mine.csv; choose another folder"):
        command.main(arguments(*words))
    with pytest.raises(InputError, match=r"would overwrite .*pairs.csv; choose another folder"):
        command.main(arguments("--pairs", tmp_path / "pairs.csv", "x.csv", "--out", tmp_path))


def _in_the_lcx(table):
    return (table.quantity == "flow") & (table.location == "lcx:BC_lcx")


@pytest.mark.parametrize(
    "change",
    [
        lambda t: t.assign(value=np.where(_in_the_lcx(t), 1e-3 * t.value, t.value)),
        lambda t: t.assign(value=np.where((t.quantity == "perfusion") & (t.condition == "rest"), 0.0, t.value)),
        lambda t: t.assign(value=np.where(t.quantity == "pressure", 0.22 * t.value, t.value)),
    ],
    ids=["a vessel all but closed", "a bed without perfusion at rest", "behind a tight stenosis"],
)
def test_what_may_be_measured_is_taken(hidden_stenosis, tmp_path, change):
    folder = hidden_stenosis[0]
    change(pd.read_csv(folder / "measurements.csv")).to_csv(tmp_path / "m.csv", index=False)
    conditions = read_conditions(folder / "conditions.yaml")
    problem = read_problem(read_network(folder / "model.json"), tmp_path / "m.csv", conditions, "c", Settings())
    assert np.isfinite(problem.y).all()


def test_means_that_set_a_free_parameter_leave_nothing_to_verify_on(hidden_stenosis, tmp_path):
    folder = hidden_stenosis[0]
    table = pd.read_csv(folder / "measurements.csv")
    table[table.statistic == "mean"].to_csv(tmp_path / "m.csv", index=False)
    content = yaml.safe_load((folder / "conditions.yaml").read_text())
    for name, entry in content.items():
        content[name] = entry | ({"free": ["coronary_resistance_scale"]} if entry.get("held_out") else {})
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match="nothing is left to verify on"):
        read_problem(
            read_network(folder / "model.json"),
            tmp_path / "m.csv",
            read_conditions(tmp_path / "c.yaml"),
            tmp_path / "c.yaml",
            Settings(),
        )


def test_a_condition_given_twice(tmp_path):
    (tmp_path / "c.yaml").write_text("rest:\nhyperaemia:\n  coronary_resistance_scale: 0.3\nrest:\n  held_out: true\n")
    with pytest.raises(InputError, match="rest is given twice"):
        read_conditions(tmp_path / "c.yaml")


def test_a_hidden_case_keeps_all_keys_of_its_conditions(tmp_path):
    """Drives and what is free, too."""
    time, aortic, _ = pressures()
    driven = Condition("low", drive={"AORTA": (time, 0.8 * aortic)}, free=("coronary_resistance_scale",), held_out=True)
    conditions = {"rest": Condition("rest"), "low": driven}
    made = open_loop()
    make_case.hide(made.network, conditions, made.plan, assume(), np.zeros(0), 1.0, 3, tmp_path)
    read = read_conditions(tmp_path / "conditions.yaml")
    assert read["low"].free == driven.free and read["low"].held_out
    assert read["low"].drive["AORTA"][1] == pytest.approx(0.8 * aortic)


def test_a_folder_without_a_name():
    with pytest.raises(InputError, match="--out = '': empty; name a folder"):
        command.main(arguments("--model", "x.json", "--out", ""))


def test_missing_arguments_are_named(tmp_path):
    with pytest.raises(InputError, match="--measurements"):
        command.main(arguments("--model", "x.json", "--out", tmp_path))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("--pairs", "a", "b", "--recordings", "f", "DOG"),
            "--recordings = ['f', 'DOG']: cannot be combined with --pairs",
        ),
        (("--pairs", "a", "b", "--model", "m.json"), "--model = 'm.json': cannot be combined with --pairs"),
        (("--recordings", "f", "DOG", "--model", "m.json"), "--model = 'm.json': cannot be combined with --recordings"),
        (("--recordings", "f", "DOG", "--conditions", "c"), "--conditions = 'c': cannot be combined with --recordings"),
    ],
)
def test_one_kind_of_input_at_a_time(tmp_path, words, said):
    with pytest.raises(InputError) as caught:
        command.main(arguments(*words, "--out", tmp_path / "out"))
    assert str(caught.value) == f"command line: {said}; remove one"
    assert not (tmp_path / "out").exists()


def test_pairs_have_no_waveforms_whose_noise_could_be_said(tmp_path):
    with pytest.raises(InputError, match="--noise = 'stated': only applies to waveforms; --pairs has none"):
        command.main(arguments("--pairs", "a", "b", "--noise", "stated", "--out", tmp_path / "out"))


def test_unknown_key_of_a_condition(tmp_path):
    (tmp_path / "c.yaml").write_text("rest:\n  resistance: 2\n")
    with pytest.raises(InputError, match="rest.resistance"):
        read_conditions(tmp_path / "c.yaml")


def test_numbers_of_a_condition_may_be_written_as_in_any_other_file(tmp_path):
    """PyYAML takes 1e3, and 1.0e3, for words."""
    (tmp_path / "c.yaml").write_text("a: {period_scale: 5e-1, scale: {BED: {R: 1e3, C: 2}}}\n")
    found = read_conditions(tmp_path / "c.yaml")["a"]
    assert (found.period_scale, found.scale) == (0.5, {"BED": {"R": 1000.0, "C": 2.0}})
    for text, said in (
        ("{scale: {BED: {R: two}}}", "a.scale.BED.R = 'two': want a number"),
        ("{set: {BED: {R: true}}}", "a.set.BED.R = True: want a number"),
        ("{period_scale: -1}", "a.period_scale = -1: want a positive number"),
        ("{period_scale: [1]}", "a.period_scale = [1]: want a number"),
    ):
        (tmp_path / "c.yaml").write_text(f"a: {text}\n")
        with pytest.raises(InputError) as caught:
            read_conditions(tmp_path / "c.yaml")
        assert str(caught.value).endswith(said)


def test_a_model_that_does_not_run_is_said_in_one_line(hidden_stenosis, tmp_path, monkeypatch):
    """No condition was found under which this model does not run, so the search is stopped by hand."""

    def stopped(problem, seed, report):
        raise FloatingPointError("the model could not be run")

    monkeypatch.setattr(search_case, "discover", stopped)
    paths = [hidden_stenosis[0] / name for name in ("model.json", "measurements.csv", "conditions.yaml")]
    with pytest.raises(
        InputError, match="conditions.yaml: the model does not run under any condition after recalibration"
    ):
        search_case.search_case(*paths, tmp_path / "out", Settings(), 1)
    assert not (tmp_path / "out").exists()


def test_condition_scales_arterioles_and_period():
    network = left_coronary()
    changed = under(network, Condition("x", coronary_resistance_scale=0.25, period_scale=0.5))
    old, new = (n["boundary_conditions"][1]["bc_values"] for n in (network, changed))
    assert new["Ra1"] == pytest.approx(0.25 * old["Ra1"]) and new["Rv1"] == old["Rv1"]
    assert new["t"][-1] == pytest.approx(0.5 * old["t"][-1])


def test_hidden_stenosis_is_named_placed_and_mended(hidden_stenosis, tmp_path, capsys):
    folder, truth = hidden_stenosis
    assert command.main(case_arguments(folder, tmp_path)) == 0
    said = capsys.readouterr()
    assert "\nbest: quadratic_stenosis at " in said.err and "checking on the held-out data" in said.err.splitlines()[-1]
    answer = json.loads(said.out)
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


def test_a_place_is_its_vessels():
    anatomy = Anatomy(open_loop()[0])
    beds = anatomy.beds
    (one, first), (other, second), *_ = beds.items()
    assert write.vessels_of(first, anatomy) == write.vessels_of(one, anatomy) == [first]
    assert write.vessels_of(f"{first}~{second}", anatomy) == write.vessels_of(f"{one}<{other}", anatomy)
    assert write.vessels_of("all beds", anatomy) == list(beds.values())
    assert write.vessels_of(f"{first}:{one}", anatomy) == write.vessels_of("every flow", anatomy) == []


def test_a_repaired_case_is_a_case_with_nothing_to_explain(hidden_stenosis, tmp_path, capsys):
    """The files that a search leaves are examined as they are."""
    command.main(case_arguments(hidden_stenosis[0], tmp_path / "out"))
    files_of = [tmp_path / "out" / name for name in ("repaired.json", "measurements.csv", "conditions.yaml")]
    words = zip(("--model", "--measurements", "--conditions"), files_of, strict=True)
    command.main(arguments(*(word for pair in words for word in pair), "--out", tmp_path / "again", "--json"))
    answer = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert not answer["alarm"] and answer["gap_before"] == pytest.approx(1.0, abs=0.2)


def test_repaired_files_give_the_fitted_predictions(hidden_stenosis, tmp_path):
    """The repaired network under the repaired conditions, without any effect, predicts what the fit predicted."""
    folder, truth = hidden_stenosis
    conditions = read_conditions(folder / "conditions.yaml")
    table = folder / "measurements.csv"
    problem = read_problem(read_network(folder / "model.json"), table, conditions, "c", Settings())
    forward = problem.forward
    for acting in (
        truth.hypothesis,
        assume(("intramyocardial_pressure", "all beds")),
        assume(("autoregulation", "all beds")),
    ):
        z = np.full(problem.count + 1, 0.4)
        z[[i for i, n in enumerate(forward.nuisances) if n.mass]] = 0.0
        wanted = forward.predict(z, acting)[0]
        network = repaired_network(forward, acting, z)
        content, drives = repaired_conditions(forward, acting, z)
        for name, waveform in drives.items():
            write_drive(tmp_path / name, *waveform)
        write_text(tmp_path / "conditions.yaml", yaml.safe_dump(content, sort_keys=False))
        again = read_conditions(tmp_path / "conditions.yaml")
        repaired = read_problem(network, table, again, "c", Settings())
        repaired.forward.masses = forward.masses
        assert repaired.forward.predict(np.zeros(repaired.count))[0] == pytest.approx(wanted, rel=3e-3)


def test_nothing_hidden_is_said_so(tmp_path, capsys):
    hide(Case((), "none", "nominal", 6), open_loop(), tmp_path)
    command.main(case_arguments(tmp_path, tmp_path / "out"))
    said = capsys.readouterr()
    assert "; nothing to explain (global test p = " in said.err and "nearest" not in said.err
    answer = json.loads(said.out)
    assert not answer["alarm"] and answer["named"] == []
    assert "nothing to explain" in answer["paragraph"]


def test_standard_deviations_far_too_large_are_said_so(hidden_stenosis, tmp_path, capsys):
    """In another unit than the value, perhaps: nothing would be seen of the stenosis."""
    for name in ("model.json", "conditions.yaml"):
        (tmp_path / name).write_text((hidden_stenosis[0] / name).read_text())
    table = pd.read_csv(hidden_stenosis[0] / "measurements.csv")
    table.assign(sd=100.0 * table.sd).to_csv(tmp_path / "measurements.csv", index=False)
    command.main(case_arguments(tmp_path, tmp_path / "out"))
    said = capsys.readouterr().out
    assert "nothing to explain" in said and "check that these are correct and in the unit of the values" in said


def test_names_that_no_condition_tests_are_said_so(hidden_stenosis, tmp_path, capsys):
    for name in ("model.json", "measurements.csv"):
        (tmp_path / name).write_text((hidden_stenosis[0] / name).read_text())
    conditions = yaml.safe_load((hidden_stenosis[0] / "conditions.yaml").read_text())
    for entry in conditions.values():
        (entry or {}).pop("held_out", None)
    (tmp_path / "conditions.yaml").write_text(yaml.safe_dump(conditions, sort_keys=False))
    command.main(case_arguments(tmp_path, tmp_path / "out"))
    said = capsys.readouterr().out
    assert "Missing is quadratic stenosis" in said and "hold a condition out" in said


def test_a_size_beyond_its_prior_is_said_so(hidden_stenosis, tmp_path, capsys):
    """A sensor off by four prior standard deviations is named with a word of doubt, one within its prior without."""
    network, conditions, plan = open_loop()
    acting = assume(("pressure_offset", "lad:BC_lad"))
    make_case.hide(network, conditions, plan, acting, np.array([4.0]), 1.0, 3, tmp_path)
    for folder, beyond in ((tmp_path, ["offset"]), (hidden_stenosis[0], [])):
        command.main(case_arguments(folder, tmp_path / "out"))
        answer = json.loads(capsys.readouterr().out)
        assert [one["beyond_prior"] for one in answer["named"]] == [beyond]
        assert ("outside the central 99 %" in answer["paragraph"]) == bool(beyond)


def pair_tables(folder, quadratic, count=120):
    """Tables of one branch whose measured side has a quadratic loss that the simulated side lacks."""
    random = np.random.default_rng(1)
    bed, own, root = 60.0 * random.uniform(0.7, 1.4, count), 3.0, 95.0 + random.normal(0, 2, count)
    simulated, measured = {}, {}
    for table, loss in ((simulated, 0.0), (measured, quadratic)):
        series = own + bed
        flow = 2 * root / (series + np.sqrt(series**2 + 4 * loss * root))
        distal = bed * flow
        table |= {"sample": range(count), "mean_pressure:heart:aorta": root, "mean_pressure:v:BC": distal}
        table |= {"mean_flow:v:BC": flow, "ffr_x": distal / root}
    for name, table in (("0d.csv", simulated), ("3d.csv", measured)):
        pd.DataFrame(table).to_csv(folder / name, index=False)


def test_quadratic_loss_is_named_from_pairs(tmp_path):
    pair_tables(tmp_path, 4.0)
    answer = discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)
    assert [(n["effect"], n["place"]) for n in answer["named"]] == [("quadratic_stenosis", "v:BC")]
    assert answer["named"][0]["coefficients"]["quadratic"] == pytest.approx(4.0, rel=0.15)
    assert answer["gap_after"] < 0.05 * answer["gap_before"]


def test_equal_pairs_leave_nothing_to_explain(tmp_path):
    pair_tables(tmp_path, 0.0)
    answer = discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)
    assert not answer["alarm"] and answer["named"] == []


def test_recalibration_finds_a_loss_many_times_the_model_s_own(tmp_path):
    """From few samples, too: it is the reference that named effects have to beat, so a worse optimum flatters them."""
    pair_tables(tmp_path, 40.0, count=24)
    (branch,) = branches(*read_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv"), "0d.csv", "3d.csv")
    ffr = branch.distal3 / branch.root3
    for kept_out in range(24):
        fit = fit_law(branch, LAWS[0], np.arange(24) != kept_out)
        assert fit.rms_ffr < 0.15 * np.sqrt(np.mean((branch.distal0 / branch.root0 - ffr) ** 2))


def test_pairs_that_no_law_explains_get_no_name(tmp_path):
    """A distal pressure that hangs on something else than flow."""
    pair_tables(tmp_path, 4.0)
    simulated, table = (pd.read_csv(tmp_path / name) for name in ("0d.csv", "3d.csv"))
    flow = simulated["mean_flow:v:BC"]
    table["ffr_x"] = simulated["ffr_x"] - 0.2 * (1.0 + np.sin(2.5 * flow / flow.std()))
    table["mean_pressure:v:BC"] = table["ffr_x"] * table["mean_pressure:heart:aorta"]
    table["mean_flow:v:BC"] = flow
    table.to_csv(tmp_path / "3d.csv", index=False)
    answer = discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)
    assert answer["alarm"] and answer["outside_library"] and answer["named"] == []
    assert "no law of loss explains it" in answer["paragraph"]


@pytest.mark.parametrize(
    ("name", "factors", "said"),
    [
        ("3d.csv", {"ffr_x": 100.0}, "want distal over root pressure, 0 to 1 (not in %)"),
        ("0d.csv", {"ffr_x": 100.0}, "want distal over root pressure, 0 to 1 (not in %)"),
        ("0d.csv", {"mean_pressure:heart:aorta": 1333.2, "mean_pressure:v:BC": 1333.2}, "both in one unit of pressure"),
    ],
)
def test_pairs_in_other_units(tmp_path, name, factors, said):
    pair_tables(tmp_path, 4.0)
    table = pd.read_csv(tmp_path / name)
    table.assign(**{column: factor * table[column] for column, factor in factors.items()}).to_csv(
        tmp_path / name, index=False
    )
    with pytest.raises(InputError) as caught:
        discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)
    assert name in str(caught.value) and said in str(caught.value)


def test_pairs_without_common_samples_say_how_each_names_them(tmp_path):
    pair_tables(tmp_path, 4.0)
    table = pd.read_csv(tmp_path / "3d.csv")
    table.assign(sample=[f"run_{number}" for number in table["sample"]]).to_csv(tmp_path / "3d.csv", index=False)
    with pytest.raises(InputError, match=r"0: samples in common .* \(0 and 'run_0'\); need at least 20"):
        discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)


def test_circuit_without_further_losses_is_the_simulation():
    one = np.array([0.5, 0.7])
    root, distal, outlet = np.array([95.0, 97.0]), np.array([90.0, 91.0]), np.array([88.0, 89.0])
    branch = Branch("x", "a:b", root, root, distal, distal, outlet, outlet, one, one, 3.0, "measured")
    ffr, flow, end = predict(branch, {})
    assert ffr == pytest.approx(distal / root) and flow == pytest.approx(one) and end == pytest.approx(outlet / root)


def test_laws_name_effects_of_the_library():
    for law in LAWS:
        assert all(effect(name).name == name for name in law.effects)


@pytest.mark.long
def test_the_published_runs_lack_a_quadratic_loss_in_all_three_branches(shared, tmp_path):
    data = shared / "data" / "menon2024"
    answer = discover_pairs(data / "outputs_0d.csv", data / "outputs_3d.csv", tmp_path, 1)
    named = {(n["branch"], n["effect"]) for n in answer["named"]}
    assert named == {(branch, "quadratic_stenosis") for branch in ("lad", "lcx", "rca")}
    for branch in answer["held_out"]["branches"]:
        assert branch["ffr_rmse"]["after"] < 0.005 < 0.1 < branch["ffr_rmse"]["before"]


def test_wilson_interval_of_a_textbook_case():
    """9 of 10: 0.596 to 0.982 (Agresti & Coull 1998, formula 4)."""
    found = wilson(9, 10)
    assert (found["low"], found["high"]) == pytest.approx((0.5958, 0.9821), abs=2e-4)


def read_again(folder, tmp_path, change):
    table = change(pd.read_csv(folder / "measurements.csv"))
    if isinstance(table, pd.DataFrame):
        table = table.to_csv(index=False)
    (tmp_path / "measurements.csv").write_text(table)
    conditions = read_conditions(folder / "conditions.yaml")
    network = read_network(folder / "model.json")
    return read_problem(network, tmp_path / "measurements.csv", conditions, "c", Settings())


def in_mmhg(table):
    pressure = table.quantity == "pressure"
    for column in ("value", "sd"):
        table[column] = np.where(pressure, table[column] / MMHG, table[column])
    return table.assign(unit=np.where(pressure, "MMHG ", table.unit.str.replace("mL", "ml")))


@pytest.mark.parametrize(
    "change",
    [
        lambda t: t[t.columns[::-1]].assign(comment="seen"),
        in_mmhg,
        lambda t: t.to_csv(index=False).replace(",", ", "),
        lambda t: t.to_csv(index=False) + "\n,,,,,,,\n",
        lambda t: t.sample(frac=1.0, random_state=1),
    ],
    ids=["columns in another order", "other units", "blanks", "empty rows", "rows in another order"],
)
def test_the_same_measurements_written_otherwise(hidden_stenosis, tmp_path, change):
    problem = read_again(hidden_stenosis[0], tmp_path, change)
    plain = read_again(hidden_stenosis[0], tmp_path, lambda t: t)
    same = [
        next(
            s
            for s in problem.forward.measured
            if (s.condition, s.location, s.quantity) == (o.condition, o.location, o.quantity)
        )
        for o in plain.forward.measured
    ]
    assert np.concatenate([s.value for s in same]) == pytest.approx(plain.y)
    assert np.concatenate([s.sd for s in same]) == pytest.approx(np.concatenate([s.sd for s in plain.forward.measured]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t.assign(time=1000.0 * t.time), "give one beat, times in s"),
        (lambda t: t.astype({"value": object}).replace({"value": {t.value[7]: "12,5"}}), "line 9: value"),
        (lambda t: t.drop(columns="sd"), "sd: column missing"),
        (lambda t: t.assign(sd=-t.sd), "line 2: sd"),
        (lambda t: t.replace("hyperaemia", "hyperemia"), "not in the conditions file; know rest, hyperaemia"),
        (lambda t: t.replace("mean", "average"), "statistic"),
        (lambda t: t[:0], "holds no measurement"),
        (lambda t: pd.concat([t, t[t.statistic == "mean"]]), "given more than once"),
    ],
    ids=[
        "milliseconds",
        "decimal comma",
        "no sd column",
        "negative sd",
        "unknown condition",
        "statistic",
        "empty",
        "twice",
    ],
)
def test_bad_tables_get_one_line(spoiled, change, said):
    assert said in spoiled(change)


def test_a_network_without_vessels(hidden_stenosis, tmp_path):
    """A block that is coupled to another solver runs, but has nowhere to look."""
    folder = hidden_stenosis[0]
    empty = {"vessels": [], "junctions": [], "boundary_conditions": []}
    write_json(tmp_path / "model.json", json.loads((folder / "model.json").read_text()) | empty)
    with pytest.raises(InputError, match="model.json: vessels: missing"):
        rest = (folder / "measurements.csv", folder / "conditions.yaml", tmp_path / "out", Settings(), 1)
        search_case.search_case(tmp_path / "model.json", *rest)
    assert not (tmp_path / "out").exists()


def test_an_answer_that_cannot_be_made_leaves_the_one_before(hidden_stenosis, tmp_path, monkeypatch):
    paths = [hidden_stenosis[0] / name for name in ("model.json", "measurements.csv", "conditions.yaml")]
    search_case.search_case(*paths, tmp_path, Settings(max_effects=0), 1)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.setattr(write, "_tree", lambda found: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        search_case.search_case(*paths, tmp_path, Settings(max_effects=0), 2)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_every_measured_condition_held_out(hidden_stenosis, tmp_path):
    folder = hidden_stenosis[0]
    content = yaml.safe_load((folder / "conditions.yaml").read_text())
    (tmp_path / "c.yaml").write_text(
        yaml.safe_dump({name: {**(keys or {}), "held_out": True} for name, keys in content.items()})
    )
    paths = ("--model", folder / "model.json", "--measurements", folder / "measurements.csv")
    with pytest.raises(InputError, match="leave one to fit"):
        command.main(arguments(*paths, "--conditions", tmp_path / "c.yaml", "--out", tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_a_bed_s_value_under_a_condition_holds_where_an_effect_changes_the_kind_of_bed():
    """What a search writes into `conditions.yaml` can be searched again."""
    network, condition = left_coronary(), Condition("x", set={"BC_lad": {"Ra2": 5.0, "Ra1": 2.0}})
    bed = next(b for b in network["boundary_conditions"] if b["bc_name"] == "BC_lad")
    bed["bc_type"], values = "CORONARY_VAR_RES", bed["bc_values"]
    values["Ra2_min"] = values["Ra2_max"] = values.pop("Ra2")
    changed = under(network, condition)
    changed = next(b for b in changed["boundary_conditions"] if b["bc_name"] == "BC_lad")["bc_values"]
    assert (changed["Ra1"], changed["Ra2_min"], changed["Ra2_max"]) == (2.0, 5.0, 5.0)


def test_a_law_knows_nothing_of_samples_that_it_is_judged_on(tmp_path):
    """Not even the measured pressure at the root."""
    pair_tables(tmp_path, 4.0)
    (branch,) = branches(*read_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv"), "0d.csv", "3d.csv")
    rows = np.arange(120) % 5 > 0
    other = replace(branch, root3=np.where(rows, branch.root3, 2.0 * branch.root3))
    law = LAWS[1]
    first, second = fit_law(branch, law, rows), fit_law(other, law, rows)
    assert second.terms == first.terms
    assert predict(other, second.terms)[0][rows] == pytest.approx(predict(branch, first.terms)[0][rows], abs=0.0)


@pytest.mark.parametrize("file", ["0d.csv", "3d.csv"])
@pytest.mark.parametrize("prefix", ["ffr_", "mean_pressure:", "mean_flow:"])
def test_the_table_that_lacks_a_column_is_named(tmp_path, file, prefix):
    pair_tables(tmp_path, 4.0)
    table = pd.read_csv(tmp_path / file)
    table.drop(columns=[column for column in table if column.startswith(prefix)]).to_csv(tmp_path / file, index=False)
    with pytest.raises(InputError, match=f"{file}: {prefix}.*no such column that both tables have"):
        discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)


def test_pairs_with_flows_in_two_units(tmp_path):
    pair_tables(tmp_path, 4.0)
    table = pd.read_csv(tmp_path / "3d.csv")
    flows = [column for column in table if "flow" in column]
    table[flows] *= 60.0
    table.to_csv(tmp_path / "3d.csv", index=False)
    with pytest.raises(InputError, match="times its flow; give both in one unit of flow"):
        discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)
    assert not (tmp_path / "out").exists()


def test_pairs_under_one_inlet_pressure(tmp_path):
    """Where the root's pressure is prescribed it is the same in every sample, and tells nothing."""
    pair_tables(tmp_path, 4.0)
    for name in ("0d.csv", "3d.csv"):
        table = pd.read_csv(tmp_path / name)
        root = table["mean_pressure:heart:aorta"]
        columns = [column for column in table if "pressure" in column]
        table[columns] = table[columns].div(root, axis=0) * 95.0
        table.to_csv(tmp_path / name, index=False)
    discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)
    found = pd.read_csv(tmp_path / "out" / "pairs.csv")
    off = [np.abs(found[name] - found["ffr_measured"]).mean() for name in ("ffr_flexible", "ffr_simulated")]
    assert off[0] < 0.3 * off[1]


def test_another_answer_leaves_nothing_of_the_one_before(tmp_path):
    out = tmp_path / "out"
    left = ("repaired.json", "measurements.csv", "difference.txt", "drives/rest_AORTA.csv", "drives/own.csv")
    for name in (*left, "notes.txt"):
        write_text(out / name, "")
    write_text(out / "conditions.yaml", "rest: {drive: {AORTA: drives/rest_AORTA.csv}}\n")
    pair_tables(tmp_path, 4.0)
    discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", out, 1)
    left = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    ours = {"discrepancy.json", "paragraph.txt", "pairs.csv", "laws.csv", "effects.csv"}
    assert left == ours | {"notes.txt", "drives/own.csv"}
    write_text(out / "measurements.csv", "")
    discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", out, 1)
    assert (out / "measurements.csv").exists(), "no repaired model beside it: somebody's own"


def test_pairs_with_a_gap_name_the_sample(tmp_path):
    count = 24
    flow, root = np.linspace(1.0, 2.0, count), np.linspace(90.0, 100.0, count)
    table = {"sample": [f"s{i}" for i in range(count)], "ffr_lad": 0.9, "mean_flow:lad:BC_lad": flow}
    table |= {"mean_pressure:AORTA:aorta": root, "mean_pressure:lad:BC_lad": 0.9 * root}
    table = pd.DataFrame(table)
    table.to_csv(tmp_path / "simulated.csv", index=False)
    table.loc[5, "ffr_lad"] = np.nan
    table.to_csv(tmp_path / "measured.csv", index=False)
    with pytest.raises(InputError, match="measured.csv: ffr_lad: no finite number in sample s5"):
        discover_pairs(tmp_path / "simulated.csv", tmp_path / "measured.csv", tmp_path / "out", 1)
