"""A folder of runs: what it may contain, and what is refused."""

import json

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.estimation.runs.table import pair, read_rows, read_runs

BOUNDS = {"min": 0.1, "max": 9.0}


def test_reads_the_published_runs(menon):
    runs = read_runs(menon)
    assert len(runs) == 500 and len(runs.inputs) == 15 and runs.theta_more.shape == (10_000, 15)
    assert runs.q_more is None and len(runs.theta_failed) == 0
    assert runs.theta_more.min() > 0.4 and runs.theta_more[:, -1].max() <= 1.25
    rows = read_rows(menon / "table1.csv")
    assert len(rows) == 12 and all(row.networks and not row.warning for row in rows)


def test_reads_a_campaign_and_aligns_by_sample_not_by_order(folder):
    outputs = pd.read_csv(folder / "outputs_0d.csv")
    outputs.iloc[::-1].to_csv(folder / "outputs_0d.csv", index=False)
    runs = read_runs(folder)
    (row,) = read_rows(folder / "rows.csv")
    np.testing.assert_array_equal(pair(runs, row)[1], 1 / runs.theta[:, 0])
    assert len(runs.q_more) == len(runs.theta_more) == 200


def test_a_failed_3d_run_is_set_apart_and_not_read_as_zero(folder):
    outputs = pd.read_csv(folder / "outputs_3d.csv")
    outputs.loc[3, "osi"] = np.nan
    outputs.drop(index=5).to_csv(folder / "outputs_3d.csv", index=False)
    runs = read_runs(folder)
    assert len(runs) == 38 and runs.theta_failed.shape == (2, 2)


@pytest.mark.parametrize(
    ("file", "spoil", "says"),
    [
        ("params.csv", lambda f: f.assign(BC_lca1=np.inf), "BC_lca1"),
        ("params.csv", lambda f: pd.concat([f, f.iloc[:1]]), "twice"),
        ("params.csv", lambda f: f[["sample"]], "contains no inputs"),
        ("outputs_3d.csv", lambda f: f.assign(sample=["x"] * len(f)), "twice"),
        ("outputs_3d.csv", lambda f: f.assign(osi="high"), "not a number"),
        ("outputs_3d.csv", lambda f: f.iloc[:1], "at least 2"),
        ("outputs_0d.csv", lambda f: f.iloc[:-1], "run the 0D model"),
        ("outputs_0d.csv", lambda f: f.assign(ffr_lad=f["ffr_lad"].where(f.index != 7)), "ffr_lad of sample_0007"),
        ("outputs_0d.csv", lambda f: f.drop(columns="sample"), "sample"),
        ("params_propagation.csv", lambda f: f.drop(columns="R_cor_scaling"), "R_cor_scaling"),
        ("outputs_0d_propagation.csv", lambda f: f.assign(sample=f["sample"] + "x"), "propagation"),
    ],
)
def test_bad_input_is_refused_on_one_line_that_names_file_and_fault(folder, file, spoil, says):
    spoil(pd.read_csv(folder / file)).to_csv(folder / file, index=False)
    with pytest.raises(InputError) as caught:
        read_runs(folder)
    assert file in str(caught.value) and says in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ("null", "expected a JSON object with min, max"),
        ('{"min": [1, 2], "max": [3, 4]}', "min.BC_lca1: expected a number for every column of params.csv"),
        ('{"min": {"BC_lca1": "low"}, "max": {}}', "min.BC_lca1 = 'low': expected a number"),
    ],
)
def test_limits_that_are_not_numbers_are_refused_on_one_line(folder, limits, says):
    (folder / "param_limits.json").write_text(limits)
    with pytest.raises(InputError) as caught:
        read_runs(folder)
    assert says in str(caught.value)


def test_inputs_of_any_sign_are_read_and_only_positive_ones_are_logged(folder):
    frame = pd.read_csv(folder / "params.csv")
    frame.assign(BC_lca1=frame["BC_lca1"] - 1).to_csv(folder / "params.csv", index=False)
    runs = read_runs(folder)
    assert runs.logged.tolist() == [False, True]
    expected = np.column_stack([runs.theta[:, 0], np.log(runs.theta[:, 1])])
    np.testing.assert_array_equal(runs.coordinates(runs.theta), expected)


def test_propagation_samples_without_a_0d_run_are_kept_as_failed(folder):
    frame = pd.read_csv(folder / "outputs_0d_propagation.csv")
    frame.loc[3, "ffr_lad"] = np.nan
    frame.drop(index=[5, 6]).to_csv(folder / "outputs_0d_propagation.csv", index=False)
    runs = read_runs(folder)
    assert len(runs.theta_more) == len(runs.q_more) == 197
    theta = pd.read_csv(folder / "params_propagation.csv")[list(runs.inputs)].to_numpy()
    np.testing.assert_array_equal(runs.theta_more_failed, theta[[3, 5, 6]])


def test_an_empty_propagation_file_is_refused_without_a_warning(folder, recwarn):
    (folder / "params_propagation.csv").unlink()
    limits = {name: dict.fromkeys(pd.read_csv(folder / "params.csv").columns[1:], v) for name, v in BOUNDS.items()}
    (folder / "param_limits.json").write_text(json.dumps(limits))
    (folder / "params_propagation_normalized.csv").write_text("")
    with pytest.raises(InputError, match=r"params_propagation_normalized.csv: empty; draw inputs"):
        read_runs(folder)
    assert not len(recwarn)


def test_a_row_with_a_missing_column_lists_the_columns(folder):
    (folder / "rows.csv").write_text("row,column_3d,column_0d\n1,osi,flow\n")
    with pytest.raises(InputError, match="flow.*ffr_lad"):
        pair(read_runs(folder), read_rows(folder / "rows.csv")[0])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("row,column_3d,column_0d\n", "no rows"),
        ("row,column_3d,column_0d\n1,osi,ffr_lad\n2,osi,\n", "column_0d of line 3: empty"),
        ("row,column_3d,column_0d\n,osi,ffr_lad\n", "row of line 2: empty"),
        ("row|column_3d|column_0d\n1|osi|ffr_lad\n", "column missing"),
        ("row,column_3d,column_0d\n1,osi,ffr_lad\n1,osi,ffr_lad\n", "twice"),
    ],
)
def test_incomplete_rows_are_refused(folder, text, says):
    (folder / "rows.csv").write_text(text)
    with pytest.raises(InputError, match=says):
        read_rows(folder / "rows.csv")


@pytest.mark.parametrize(
    "text",
    [
        "row, column_3d, column_0d\n1, osi , ffr_lad\n",
        "\ufeffrow,column_3d,column_0d\r\n1,osi,ffr_lad\r\n",
        "column_0d,note,row,column_3d\nffr_lad,hello,1,osi\n",
    ],
)
def test_rows_may_have_spaces_byte_order_marks_and_extra_columns(folder, text):
    (folder / "rows.csv").write_text(text)
    (row,) = read_rows(folder / "rows.csv")
    assert (row.name, row.column_3d, row.column_0d) == ("1", "osi", "ffr_lad")


def test_a_coarse_run_that_failed_leaves_the_pilot_whole(with_coarse):
    lines = pd.read_csv(with_coarse / "outputs_3d_coarse.csv")
    lines.drop(index=[3, 100]).to_csv(with_coarse / "outputs_3d_coarse.csv", index=False)
    runs = read_runs(with_coarse)
    assert len(runs) == 40 and runs.coarse.outputs["osi"].isna().to_numpy().nonzero()[0].tolist() == [3, 100]
    assert len(runs.coarse.theta) == len(runs.coarse.q) == 120


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("outputs_3d_coarse.csv", "sample,osi\nnobody,0.1\n", "nobody"),
        ("outputs_3d_coarse.csv", "sample,ffr\nsample_0000,0.1\n", "ffr.*no such column in outputs_3d.csv"),
        ("params_coarse.csv", "sample,BC_lca1\nsample_0040,1.0\n", "R_cor_scaling"),
        ("params_coarse.csv", "sample,BC_lca1,R_cor_scaling\nsample_0001,1.0,1.0\n", "sample_0040"),
        ("outputs_0d_coarse.csv", "sample,ffr_lad\nsample_0040,0.9\n", "mean_flow:lca1:BC_lca1 of sample_0040"),
    ],
)
def test_tables_of_the_coarse_level_that_do_not_fit_are_refused(with_coarse, file, text, said):
    (with_coarse / file).write_text(text)
    with pytest.raises(InputError, match=said):
        read_runs(with_coarse)


def test_rows_say_whether_networks_are_trained_for_them(folder):
    rows = {"row": ["a", "b", "c"], "column_3d": "osi", "column_0d": "ffr_lad", "networks": ["yes", "no", None]}
    pd.DataFrame(rows | {"warning": ["", "an extreme", None]}).to_csv(folder / "rows.csv", index=False)
    read = read_rows(folder / "rows.csv")
    assert [(row.networks, row.warning) for row in read] == [(True, ""), (False, "an extreme"), (True, "")]
    assert all(row.shared for row in read)
    pd.DataFrame(rows | {"networks": ["yes", "no", "maybe"]}).to_csv(folder / "rows.csv", index=False)
    pd.DataFrame(rows | {"shared": ["no", "yes", "perhaps"]}).to_csv(folder / "shared.csv", index=False)
    with pytest.raises(InputError, match="shared.*perhaps.*write yes or no"):
        read_rows(folder / "shared.csv")
    with pytest.raises(InputError, match="networks.*maybe.*write yes or no"):
        read_rows(folder / "rows.csv")
