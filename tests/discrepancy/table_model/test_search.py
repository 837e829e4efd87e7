"""The search on table models names missing losses, abstains outside the library and rejects invalid tables."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_text
from coronaryuq.discrepancy.table_model.search import discover_pairs
from coronaryuq.discrepancy.table_model.summary_text import TOGETHER
from support.pair_tables import exact_pairs, noisy_pairs


@pytest.fixture(scope="module")
def quadratic(tmp_path_factory):
    """A searched loss of 4 without noise: folder of the results, and answer."""
    folder = tmp_path_factory.mktemp("quadratic")
    exact_pairs(folder, 4.0)
    return folder / "out", discover_pairs(folder / "0d.csv", folder / "3d.csv", folder / "out", 1)


@pytest.fixture(scope="module")
def noisy(tmp_path_factory):
    """A searched loss of 10 with noise: both tables, and answer."""
    folder = tmp_path_factory.mktemp("noisy")
    files = noisy_pairs(folder, 1, quadratic=10.0)
    return files, discover_pairs(*files, folder / "out", 1)


@pytest.mark.slow
def test_a_quadratic_loss_is_named(quadratic):
    _, answer = quadratic
    assert [(n["effect"], n["place"]) for n in answer["named"]] == [("quadratic_stenosis", "v:BC")]
    assert answer["named"][0]["coefficients"]["quadratic"] == pytest.approx(4.0, rel=0.15)
    assert answer["gap_after"] < 0.05 * answer["gap_before"]


@pytest.mark.slow
def test_the_named_loss_changes_the_prediction_to_what_was_measured(quadratic):
    folder, answer = quadratic
    predicted = answer["held_out"]["branches"][0]["prediction"]
    pairs, table = (pd.read_csv(folder / name) for name in ("pairs.csv", "predicted.csv"))
    for model, own in predicted.items():
        ffr = pairs[f"ffr_{model}"]
        assert [own["low"], own["median"], own["high"]] == pytest.approx(np.quantile(ffr, [0.05, 0.5, 0.95]).tolist())
        assert own["at_most"]["0.80"] == pytest.approx(np.mean(ffr <= 0.8))
        row = table[table.model == model].iloc[0]
        assert row.ffr_median == pytest.approx(own["median"]) and row["at_most_0.75"] == own["at_most"]["0.75"]
    off = {model: abs(own["median"] - predicted["measured"]["median"]) for model, own in predicted.items()}
    assert off["repaired"] < 0.05 * off["simulated"]


@pytest.mark.long
def test_equal_tables_leave_nothing_to_explain(tmp_path):
    exact_pairs(tmp_path, 0.0)
    answer = discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)
    assert not answer["alarm"] and answer["named"] == []


@pytest.mark.long
def test_no_effect_is_named_if_no_law_explains_the_pairs(tmp_path):
    """The distal pressure depends on something other than a loss law."""
    exact_pairs(tmp_path, 4.0)
    simulated, table = (pd.read_csv(tmp_path / name) for name in ("0d.csv", "3d.csv"))
    flow = simulated["mean_flow:v:BC"]
    table["ffr_x"] = simulated["ffr_x"] - 0.2 * (1.0 + np.sin(2.5 * flow / flow.std()))
    table["mean_pressure:v:BC"] = table["ffr_x"] * table["mean_pressure:heart:aorta"]
    table["mean_flow:v:BC"] = flow
    table.to_csv(tmp_path / "3d.csv", index=False)
    answer = discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)
    assert answer["alarm"] and answer["outside_library"] and answer["named"] == []
    assert "no pressure-loss law explains it" in answer["paragraph"]


def with_a_further_drop(table, drop):
    """The measured table with a further drop (n,) ahead of its distal pressure and outlet."""
    root = table["mean_pressure:heart:aorta"]
    return table.assign(
        **{"ffr_x": table.ffr_x - drop / root, "mean_pressure:v1:BC": table["mean_pressure:v1:BC"] - drop}
    )


@pytest.mark.slow
def test_a_loss_of_another_form_is_not_named_although_a_smooth_regression_misses_it_as_well(tmp_path):
    """It begins at the mean flow, and the measured flows are not those that the model has."""
    files = noisy_pairs(tmp_path, 3, count=200)
    measured, random = pd.read_csv(files[1]), np.random.default_rng(3)
    factor = np.exp(random.uniform(-0.25, 0.25, len(measured)))
    more = (factor - 1.0) * measured["mean_flow:v1:BC"]
    measured["mean_flow:v1:BC"] *= factor
    flow = measured["mean_flow:v1:BC"] / measured["mean_flow:v1:BC"].mean()
    # Own losses of 3 and 2 before and after the distal location, and the further one.
    measured = with_a_further_drop(measured, 3.0 * more + 30.0 * np.maximum(flow - 1.1, 0.0))
    measured["mean_pressure:v1:BC"] -= 2.0 * more
    measured.to_csv(files[1], index=False)
    answer = discover_pairs(*files, tmp_path / "out", 1)
    assert answer["outside_library"] and answer["named"] == []


@pytest.mark.slow
def test_a_loss_that_depends_on_another_branch_is_not_named(tmp_path):
    """A regression on this branch alone cannot predict it, and so does not show that the law misses it."""
    (tmp_path / "other").mkdir()
    files, others = noisy_pairs(tmp_path, 4), noisy_pairs(tmp_path / "other", 5)
    simulated, beside = (pd.read_csv(one) for one in (files[0], others[0]))
    flow = beside["mean_flow:v1:BC"] / beside["mean_flow:v1:BC"].mean()
    with_a_further_drop(pd.read_csv(files[1]), 15.0 * flow**2).to_csv(files[1], index=False)
    for own, other in zip(files, others, strict=True):
        table, more = pd.read_csv(own), pd.read_csv(other)
        same_root = table["mean_pressure:heart:aorta"] / more["mean_pressure:heart:aorta"]
        for column in more.columns.drop(["sample", "mean_pressure:heart:aorta"]):
            factor = 1.0 if column.startswith("ffr") else same_root
            table[column.translate(str.maketrans("xvBJ", "ywDK"))] = factor * more[column]
        table.to_csv(own, index=False)
    answer = discover_pairs(*files, tmp_path / "out", 1)
    (branch,) = (one for one in answer["held_out"]["branches"] if one["branch"] == "x")
    assert branch["outside_library"] and branch["effects"] == []


@pytest.mark.slow
def test_the_column_of_the_distal_pressure_is_reported(noisy):
    _, answer = noisy
    assert answer["held_out"]["branches"][0]["distal_pressure"] == "mean_pressure:v0:J"
    assert "the pressure drop to v0:J is " in answer["paragraph"]


@pytest.mark.slow
def test_permuted_rows_raise_a_doubt(noisy, tmp_path):
    (simulated, measured), same = noisy
    assert same["held_out"]["branches"][0]["rank_correlation"] > 0.9 and "same sample" not in same["paragraph"]
    table = pd.read_csv(measured)
    values = table.columns != table.columns[0]
    order = np.random.default_rng(3).permutation(len(table))
    table.loc[:, values] = table.loc[order, values].to_numpy()
    table.to_csv(tmp_path / "3d.csv", index=False)
    answer = discover_pairs(simulated, tmp_path / "3d.csv", tmp_path / "out", 1)
    assert answer["held_out"]["branches"][0]["rank_correlation"] < TOGETHER
    assert "check that a row of both tables is the same sample" in answer["paragraph"]


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.2, pytest.param(0.35, marks=pytest.mark.long)])
def test_a_model_with_too_large_a_loss_lacks_no_effect(tmp_path, share):
    """The model's loss is 3; the measurements have a fraction of it."""
    answer = discover_pairs(*noisy_pairs(tmp_path, 5, linear=3.0 * (share - 1.0)), tmp_path / "out", 1)
    assert answer["outside_library"] and not answer["named"]
    assert "The model appears to have a loss that is absent in reality, or too large a loss" in answer["paragraph"]


@pytest.mark.slow
def test_a_drop_explained_by_recalibration_is_reported_as_such(tmp_path):
    answer = discover_pairs(*noisy_pairs(tmp_path, 6, linear=1.0), tmp_path / "out", 1)
    assert not answer["named"] and not answer["alarm"]
    assert "which recalibration explains: it multiplies the model's own loss by 1.3" in answer["paragraph"]


@pytest.mark.long
def test_a_loss_beyond_recalibration_raises_an_alarm(tmp_path):
    """Two and a half times the model's own loss, in the same form."""
    answer = discover_pairs(*noisy_pairs(tmp_path, 7, linear=4.5), tmp_path / "out", 1)
    assert answer["alarm"] and not answer["outside_library"]


@pytest.mark.long
def test_a_stenosis_with_an_offset_is_not_mistaken_for_too_large_a_loss(tmp_path):
    answer = discover_pairs(*noisy_pairs(tmp_path, 8, quadratic=1.5, offset=3.0), tmp_path / "out", 1)
    assert "quadratic_stenosis" in [one["effect"] for one in answer["named"]]
    assert not answer["held_out"]["branches"][0]["overstated"]


@pytest.mark.slow
def test_constant_inputs_leave_the_gaussian_process_the_mean(tmp_path):
    """Runs of a single parameter set contain nothing else to learn from."""
    files = noisy_pairs(tmp_path, 1)
    simulated = pd.read_csv(files[0])
    simulated.iloc[:, 1:] = simulated.iloc[0, 1:].to_numpy(float)
    simulated.to_csv(files[0], index=False)
    measured = pd.read_csv(files[1])
    discover_pairs(*files, tmp_path / "out", 1)
    flexible = pd.read_csv(tmp_path / "out" / "pairs.csv").ffr_flexible
    assert flexible.to_numpy() == pytest.approx(measured.ffr_x.mean(), abs=3 * measured.ffr_x.std())


@pytest.mark.long
def test_a_prescribed_root_pressure_is_no_input_of_the_gaussian_process(tmp_path):
    """A prescribed root pressure is the same in every sample and uninformative."""
    exact_pairs(tmp_path, 4.0)
    for name in ("0d.csv", "3d.csv"):
        table = pd.read_csv(tmp_path / name)
        root = table["mean_pressure:heart:aorta"]
        columns = [column for column in table if "pressure" in column]
        table[columns] = table[columns].div(root, axis=0) * 95.0
        table.to_csv(tmp_path / name, index=False)
    discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)
    pairs = pd.read_csv(tmp_path / "out" / "pairs.csv")
    errors = [np.abs(pairs[name] - pairs["ffr_measured"]).mean() for name in ("ffr_flexible", "ffr_simulated")]
    assert errors[0] < 0.3 * errors[1]


@pytest.mark.long
def test_results_replace_those_of_an_earlier_search(tmp_path):
    out = tmp_path / "out"
    left = ("repaired.json", "measurements.csv", "difference.txt", "drives/rest_AORTA.csv", "drives/own.csv")
    for name in (*left, "notes.txt"):
        write_text(out / name, "")
    write_text(out / "conditions.yaml", "rest: {drive: {AORTA: drives/rest_AORTA.csv}}\n")
    exact_pairs(tmp_path, 4.0)
    discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", out, 1)
    left = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    ours = {"discrepancy.json", "paragraph.txt", "pairs.csv", "laws.csv", "effects.csv", "predicted.csv"}
    assert left == ours | {"notes.txt", "drives/own.csv"}
    write_text(out / "measurements.csv", "")
    discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", out, 1)
    assert (out / "measurements.csv").exists(), "no repaired model next to it: a file of the user"


@pytest.mark.parametrize(
    ("name", "factors", "text"),
    [
        ("3d.csv", {"ffr_x": 100.0}, "expected distal over root pressure, 0 to 1 (not in %)"),
        ("0d.csv", {"ffr_x": 100.0}, "expected distal over root pressure, 0 to 1 (not in %)"),
        ("0d.csv", {"mean_pressure:heart:aorta": 1333.2, "mean_pressure:v:BC": 1333.2}, "both in one unit of pressure"),
    ],
)
def test_ffr_in_percent_and_pressures_in_two_units_are_rejected(tmp_path, name, factors, text):
    exact_pairs(tmp_path, 4.0)
    table = pd.read_csv(tmp_path / name)
    table.assign(**{column: factor * table[column] for column, factor in factors.items()}).to_csv(
        tmp_path / name, index=False
    )
    with pytest.raises(InputError) as caught:
        discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)
    assert name in str(caught.value) and text in str(caught.value)


def test_flows_in_two_units_are_rejected(tmp_path):
    exact_pairs(tmp_path, 4.0)
    table = pd.read_csv(tmp_path / "3d.csv")
    flows = [column for column in table if "flow" in column]
    table[flows] *= 60.0
    table.to_csv(tmp_path / "3d.csv", index=False)
    with pytest.raises(InputError, match="times as large; give both in one unit of flow"):
        discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)
    assert not (tmp_path / "out").exists()


def test_tables_without_common_samples_are_rejected(tmp_path):
    exact_pairs(tmp_path, 4.0)
    table = pd.read_csv(tmp_path / "3d.csv")
    table.assign(sample=[f"run_{number}" for number in table["sample"]]).to_csv(tmp_path / "3d.csv", index=False)
    with pytest.raises(
        InputError,
        match=r"samples in common with .* = 0: expected at least 20; compare the sample names \('0' and 'run_0'\)",
    ):
        discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)


@pytest.mark.parametrize("file", ["0d.csv", "3d.csv"])
@pytest.mark.parametrize("prefix", ["ffr_", "mean_pressure:", "mean_flow:"])
def test_the_table_that_lacks_a_column_is_reported(tmp_path, file, prefix):
    exact_pairs(tmp_path, 4.0)
    table = pd.read_csv(tmp_path / file)
    table.drop(columns=[column for column in table if column.startswith(prefix)]).to_csv(tmp_path / file, index=False)
    with pytest.raises(InputError, match=f"{file}: {prefix}.*no such column in both tables"):
        discover_pairs(tmp_path / "0d.csv", tmp_path / "3d.csv", tmp_path / "out", 1)


def test_a_missing_value_names_the_sample(tmp_path):
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


@pytest.mark.parametrize(("table", "value"), [(0, 0.0), (1, 0.0), (1, -0.01)])
def test_a_flow_that_is_not_downstream_is_rejected(tmp_path, table, value):
    files = noisy_pairs(tmp_path, 1, quadratic=1.0)
    frame = pd.read_csv(files[table])
    frame.loc[7, "mean_flow:v1:BC"] = value
    frame.to_csv(files[table], index=False)
    with pytest.raises(InputError, match=r"mean_flow:v1:BC = .*: in sample s7; expected a positive"):
        discover_pairs(*files, tmp_path / "out", 1)
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_the_published_runs_lack_a_quadratic_loss_in_all_three_branches(shared, tmp_path):
    data = shared / "data" / "menon2024"
    answer = discover_pairs(data / "outputs_0d.csv", data / "outputs_3d.csv", tmp_path, 1)
    named = {(n["branch"], n["effect"]) for n in answer["named"]}
    assert named == {(branch, "quadratic_stenosis") for branch in ("lad", "lcx", "rca")}
    for branch in answer["held_out"]["branches"]:
        assert branch["ffr_rmse"]["after"] < 0.005 < 0.1 < branch["ffr_rmse"]["before"]
