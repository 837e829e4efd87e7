"""`coronaryuq.estimate`: arrays in, means with their intervals, covariance and warnings out."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import coronaryuq
from coronaryuq.core.errors import InputError
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.analysis.estimate_rows import analyse
from coronaryuq.estimation.arrays import estimate
from coronaryuq.estimation.runs.table import Row
from coronaryuq.estimation.settings import Settings
from support.runs import runs_of

MEANS = np.array([2.0, -3.5])
"""Of `expensive` for standard normal inputs."""


def cheap(theta):
    return np.column_stack([theta[:, 0] + theta[:, 1], theta[:, 1] ** 2])


def expensive(theta):
    return np.column_stack([2 + theta[:, 0] + 0.8 * theta[:, 1], -4 + 0.5 * theta[:, 1] ** 2 + theta[:, 0] ** 3 / 6])


def drawn(n, m, *name):
    rng = generator(3, "arrays", *name)
    return rng.normal(size=(n, 2)), rng.normal(size=(m, 2))


@pytest.fixture(scope="module")
def given():
    theta, more = drawn(40, 600)
    return {"theta": theta, "y": expensive(theta), "q": cheap(theta), "theta_more": more, "q_more": cheap(more)}


@pytest.fixture(scope="module")
def estimated(given):
    return estimate(**given)


def test_inputs_and_outputs_of_any_sign_are_estimated(estimated):
    assert np.all(np.abs(estimated.mean - MEANS) < 4 * estimated.std)
    assert np.all((estimated.interval[:, 0] < estimated.mean) & (estimated.mean < estimated.interval[:, 1]))
    std = estimated.table().set_index(["column_3d", "estimator"])["std"]
    assert std["y_0", "crossfit-GP"] < 0.5 * std["y_0", "MC"] and std["y_1", "crossfit-GP"] < std["y_1", "MC"]
    assert estimated.warnings == tuple(dict.fromkeys(estimated.warnings))


def test_the_covariance_has_the_reported_variances_and_the_budget_adds_up_to_them(estimated):
    np.testing.assert_allclose(np.diag(estimated.covariance), estimated.std**2)
    np.testing.assert_allclose(estimated.budget.sum(axis=1), estimated.std**2)
    assert np.linalg.eigvalsh(estimated.covariance).min() > 0
    assert list(estimated.budget.columns) == ["runs_3d", "propagation", "chain"]
    assert (estimated.budget["chain"] == 0).all()


def test_the_table_marks_the_recommended_estimator_of_each_quantity(estimated):
    table = estimated.table()
    marked = table[table["recommended"]].set_index("column_3d")
    assert tuple(marked.loc[list(estimated.names), "estimator"]) == estimated.recommended
    np.testing.assert_array_equal(marked.loc[list(estimated.names), "mean"], estimated.mean)
    assert {"MC", "MFMC", "crossfit-GP"} == set(table["estimator"])
    assert repr(estimated).startswith(f"y_0: {estimated.mean[0]:.6g} (95 % interval ")


def test_one_quantity_gives_single_values_and_data_frames_give_names(given):
    theta = pd.DataFrame(given["theta"], columns=["inflow", "resistance"], index=np.arange(40) + 7)
    more = pd.DataFrame(given["theta_more"][:, ::-1], columns=["resistance", "inflow"])
    q = pd.Series(given["q"][:, 0], name="flow")
    one = estimate(theta, given["y"][:, 0], q, more, pd.Series(given["q_more"][:, 0], name="flow"))
    assert isinstance(one.mean, float) and isinstance(one.covariance, float) and isinstance(one.recommended, str)
    assert one.interval.shape == (2,) and one.names == ("y",) and one.covariance == pytest.approx(one.std**2)
    assert set(one.table()["column_0d"]) == {"flow"}
    arrays = estimate(given["theta"], given["y"][:, 0], given["q"][:, 0], given["theta_more"], given["q_more"][:, 0])
    np.testing.assert_array_equal(one.interval, arrays.interval)


def test_outputs_of_one_name_are_a_pair_and_others_are_by_position(given):
    y = pd.DataFrame(given["y"], columns=["a", "b"])
    q = pd.DataFrame(given["q"], columns=["b", "c"])
    table = estimate(given["theta"], y, q, given["theta_more"]).table()
    assert dict(zip(table["column_3d"], table["column_0d"], strict=True)) == {"a": "b", "b": "b"}
    table = estimate(given["theta"], y["a"], q.assign(b=1.0), given["theta_more"]).table()
    assert set(table["column_0d"]) == {"c"}


def test_positive_inputs_give_the_numbers_of_a_campaign(given):
    """The same estimators: a campaign's runs with inputs and outputs of these names, bit for bit."""
    theta, more = np.exp(given["theta"]), np.exp(given["theta_more"])
    q = dict(zip(("ffr_a", "ffr_b"), given["q"].T, strict=True))
    q_more = dict(zip(("ffr_a", "ffr_b"), given["q_more"].T, strict=True))
    runs = runs_of(theta, {"y": given["y"][:, 0]}, q, more, q_more=q_more)
    row = analyse(runs, [Row("y", "y", "ffr_a", "y")], Settings(known_scaling=None), 1, beyond_mean=False)[0]
    one = estimate(theta, given["y"][:, 0], pd.DataFrame(q), more, pd.DataFrame(q_more))
    assert one.rows[0].estimators == row.estimators and one.recommended == row.recommended


def test_inputs_that_are_not_positive_are_seen_as_they_are():
    theta = np.array([[1.0, -2.0], [3.0, 0.5]])
    runs = runs_of(theta, {"y": [0.0, 1.0]}, {"q": [0.0, 1.0]}, np.array([[2.0, 1.0]]))
    assert runs.logged.tolist() == [True, False]
    seen = runs.coordinates(theta)
    np.testing.assert_array_equal(seen, np.column_stack([np.log(theta[:, 0]), theta[:, 1]]))
    np.testing.assert_allclose(runs.from_coordinates(seen), theta)


@pytest.mark.slow
def test_failed_propagation_runs_are_counted_and_left_out(given):
    lost = given["q_more"].copy()
    lost[np.argsort(given["theta_more"][:, 0])[-30:]] = np.nan
    got = estimate(**given | {"q_more": lost})
    found = [warning for warning in got.warnings if "propagation runs failed" in warning]
    assert len(found) == 1 and found[0].startswith(
        "propagation runs failed: 30 of 600 0D runs at propagation samples failed, not at random: theta_0 differs"
    )
    assert got.rows[0].n_propagation == 570
    lost = given["q_more"].copy()
    lost[:5, 1] = np.inf
    assert any(
        w.startswith("propagation runs failed: 5 of 600 0D runs at propagation samples failed (left out")
        for w in estimate(**given | {"q_more": lost}).warnings
    )


def test_states_of_a_chain_widen_the_interval(given):
    states = np.zeros(640), np.repeat(np.arange(80), 8)
    rng = generator(3, "chain")
    walk = np.empty((80, 2))
    walk[0] = rng.normal(size=2)
    for i in range(1, 80):
        walk[i] = 0.9 * walk[i - 1] + np.sqrt(1 - 0.81) * rng.normal(size=2)
    order = rng.permutation(640)
    theta = np.repeat(walk, 8, axis=0)[order]
    pilot, more = theta[:40], theta[40:]
    arguments = pilot, expensive(pilot)[:, 0], cheap(pilot), more, cheap(more)
    got = estimate(*arguments, chains=tuple(numbers[order] for numbers in states))
    assert got.budget["chain"].item() > got.budget["propagation"].item()
    assert got.covariance == pytest.approx(got.std**2)


def spoiled(values, at, value):
    changed = np.array(values, dtype=float)
    changed[at] = value
    return changed


@pytest.mark.parametrize(
    ("name", "value", "line"),
    [
        ("y", lambda g: spoiled(g["y"], (3, 1), np.nan), "estimate: y, row 3, y_1 = nan: leave this row out of"),
        ("theta", lambda g: spoiled(g["theta"], (0, 0), np.inf), "estimate: theta, row 0, theta_0 = inf: leave"),
        ("q", lambda g: spoiled(g["q"], (39, 0), np.nan), "estimate: q, row 39, q_0 = nan: leave this row"),
        ("theta_more", lambda g: spoiled(g["theta_more"], (5, 1), np.nan), "estimate: theta_more, row 5, theta_1 ="),
        ("y", lambda g: g["y"][:-1], "estimate: y = 39: rows; theta has 40"),
        ("q_more", lambda g: g["q_more"][1:], "estimate: q_more = 599: rows; theta_more has 600"),
        ("q_more", lambda g: g["q_more"][:, 0], "estimate: q_more = 'q_0': column missing; expected the 2 of q"),
        ("theta_more", lambda g: g["theta_more"][:, 0], "estimate: theta_more = 'theta_0': column missing; expected"),
        ("level", lambda g: 95, "estimate: level = 95: expected a confidence level"),
        ("chains", lambda g: np.zeros(640), "estimate: chains: expected two arrays"),
        ("chains", lambda g: (np.zeros(640), np.zeros(40)), "estimate: chains, draw = (40,): expected 640 numbers"),
        ("chains", lambda g: (np.full(640, 0.5), np.zeros(640)), "estimate: chains, chain 0 = 0.5: not a whole number"),
        ("y", lambda g: [["a", "b"]] * 40, "estimate: y: expected numbers"),
        ("theta", lambda g: np.zeros((40, 2, 1)), "estimate: theta = (40, 2, 1): expected an array of one or two"),
    ],
)  # fmt: skip
def test_wrong_arguments_are_one_line(given, name, value, line):
    with pytest.raises(InputError) as caught:
        estimate(**given | {name: value(given)})
    assert str(caught.value).startswith(line) and "\n" not in str(caught.value)


def test_too_few_runs_are_one_line(given):
    few = {name: given[name][:10] for name in ("theta", "y", "q")}
    with pytest.raises(InputError, match="estimate: y = 10: rows; at least 20 are needed"):
        estimate(**given | few)
    with pytest.raises(InputError, match="theta_more = 0: rows in addition to 600 whose q_more is not finite"):
        estimate(**given | {"q_more": np.full((600, 2), np.nan)})


@pytest.mark.slow
def test_a_masked_run_is_no_run(given):
    y = np.ma.masked_array(given["y"], mask=np.arange(80).reshape(40, 2) == 6)
    with pytest.raises(InputError, match="y, row 3, y_0 = nan: leave this row out"):
        estimate(**given | {"y": y})
    masked = np.ma.masked_array(given["q_more"], mask=np.zeros((600, 2)))
    masked[5] = np.ma.masked
    assert "1 of 600 0D runs" in " ".join(estimate(**given | {"q_more": masked}).warnings)


@pytest.mark.parametrize("name", ["y", "q"])
def test_tables_in_different_orders_are_not_paired(given, name):
    tables = {key: pd.DataFrame(values) for key, values in given.items()}
    tables[name] = tables[name].iloc[::-1]
    with pytest.raises(InputError, match=f"{name} = 39: rows are in another order than those of theta"):
        estimate(**tables)
    tables[name].index = range(100, 140)  # labels of its own say nothing of the order
    estimate(**tables)


def test_one_input_many_times_is_no_sample(given):
    same = given | {name: np.repeat(given[name][:1], 40, axis=0) for name in ("theta", "y", "q")}
    with pytest.raises(InputError, match="theta = 1: different inputs among 40"):
        estimate(**same)
    with pytest.raises(InputError, match="theta = 1: different inputs among 40"):
        estimate(**given, chains=(np.zeros(640), np.zeros(640)))


def test_a_quantity_that_is_the_same_in_all_runs_has_no_error(given):
    """By whatever value: the mean of 40 equal numbers is not always equal to them."""
    found = estimate(**given | {"y": np.full(40, 1.1712834)})
    assert found.recommended == "MC" and found.mean == pytest.approx(1.1712834, rel=1e-14)
    told = " ".join(found.warnings)
    assert "all 40 runs have the value 1.17128" in told and "disagree" not in told


def test_the_error_can_be_caught_by_its_public_name(given):
    with pytest.raises(coronaryuq.InputError, match="y: expected real numbers; it is complex"):
        estimate(**given | {"y": given["y"] + 1j})
    assert "InputError" in dir(coronaryuq) and issubclass(coronaryuq.InputError, ValueError)


def test_the_examples_of_the_page_run(capsys):
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "estimate.md").read_text(encoding="utf-8")
    names: dict = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(compile(block, "estimate.md", "exec"), names)
    assert abs(names["difference"] + 1.057) < 5 * names["std"]
    assert names["chained"].budget["chain"].min() > 0
    assert names["combined"].std < names["pilot"].fine.std() / 60**0.5
    assert names["plan"].variance < names["pilot"].fine.var() / 100
    assert "0D runs at propagation samples failed, not at random: drive differs" in capsys.readouterr().out


def test_it_is_a_public_name():
    assert coronaryuq.estimate is estimate


def test_repeated_states_of_an_unnamed_chain_are_told_that_its_error_is_missing():
    """Their order is lost, and with it what the chain's correlation adds."""
    rng = generator(3, "unnamed")
    states = np.cumsum(rng.normal(size=(150, 2)), axis=0) / 10
    drawn_from = states[rng.integers(150, size=440)]
    theta, more = drawn_from[:40], drawn_from[40:]
    found = estimate(theta, expensive(theta), cheap(theta), more, cheap(more))
    (warning,) = (w for w in found.warnings if w.startswith("dependent samples"))
    assert "repeated" in warning and "the chain's own error is not known" in warning
