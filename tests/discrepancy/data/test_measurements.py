"""The measurement table is read in many spellings, and rejected with one line that says what is wrong."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.cli import discrepancy as command
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MMHG
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.data.measurements import read_table
from coronaryuq.discrepancy.inference.read_problem import read_problem
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.network.read import read_network
from support.discrepancy_command import case_arguments


def test_an_unknown_location_is_answered_with_similar_ones(error_of):
    message = error_of(lambda t: t.assign(location=t.location.replace("lad:BC_lad", "lad:BC_lda")))
    assert "BC_lda" in message and "similar: " in message and "lad:BC_lad" in message


def test_a_unit_of_another_quantity_is_rejected(error_of):
    message = error_of(lambda t: t.assign(unit=t.unit.replace("mL/s", "mmHg")))
    assert "unit" in message and "'mmHg'" in message and "mL/min" in message


def test_a_missing_standard_deviation_names_the_line(error_of):
    def change(table):
        table.loc[3, "sd"] = np.nan
        return table

    assert "line 5: sd" in error_of(change)


def test_the_named_line_is_that_of_the_file(error_of, tmp_path):
    error_of(lambda t: t.assign(sd=np.where(t.index == 3, -1.0, t.sd)))
    path = tmp_path / "measurements.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(["# mine", lines[0], "", *lines[1:3], "# more", *lines[3:]]) + "\n")
    with pytest.raises(InputError, match=r"line 8: sd = -1\.0"):
        command.main(case_arguments(tmp_path, tmp_path / "out"))


def test_duplicate_columns_are_rejected(error_of):
    assert "value: duplicate column; keep one" in error_of(
        lambda t: t.assign(Value=1.0).rename(columns={"value": "VALUE"})
    )


def test_a_waveform_with_a_large_gap_is_rejected(error_of):
    message = error_of(lambda t: t[~(t.time > 0.5)])
    assert "does not cover the cycle" in message


@pytest.mark.parametrize(("shift", "factor"), [(0.45, 1.0), (-0.2, 1.0), (0.0, 1.0 / 0.85)])
def test_a_waveform_outside_the_beat_is_rejected(error_of, shift, factor):
    """In the last case times are fractions of the beat instead of seconds."""
    message = error_of(lambda t: t.assign(time=factor * t.time + shift))
    assert "outside the beat of 0.85 s; give times in s from its start" in message


def test_a_duplicate_time_is_rejected(error_of):
    message = error_of(lambda t: pd.concat([t, t[t.statistic == "waveform"].iloc[[2]]]))
    assert ": time = " in message and "duplicate time; keep one row" in message


def test_a_beat_may_end_with_its_first_sample_again(stenosis_case, tmp_path):
    """Two samples of one phase have the same noise; their correlations had no inverse."""
    plain = read_changed(stenosis_case[0], tmp_path, lambda table: table).forward.measured
    periods = {series.condition: series.period for series in plain}

    def closed(table):
        waveforms = table[table.statistic == "waveform"]
        first = waveforms.loc[waveforms.groupby(["condition", "quantity", "location"]).time.idxmin()]
        return pd.concat([table, first.assign(time=first.time + first.condition.map(periods))])

    again = read_changed(stenosis_case[0], tmp_path, closed).forward.measured
    for one, other in zip(plain, again, strict=True):
        np.testing.assert_array_equal(one.value, other.value)


def test_two_sensors_of_one_name_are_told_by_their_units(error_of):
    def change(table):
        rows = (table.statistic == "waveform") & (table.quantity == "flow")
        table.loc[rows & (np.arange(len(table)) % 2 == 1), "unit"] = "mL/min"
        return table

    assert "unit = 'mL/s, mL/min': a series has one unit; keep the rows of one sensor" in error_of(change)


def test_a_waveform_of_a_few_readings_and_their_interpolation_is_rejected(error_of):
    def change(table):
        rows = (table.statistic == "waveform") & (table.location == table.location[0])
        rows &= (table.quantity == table.quantity[0]) & (table.condition == table.condition[0])
        time = table.time[rows].to_numpy()
        read = time[::8]
        table.loc[rows, "value"] = np.interp(time, read, np.random.default_rng(0).normal(5.0, 2.0, len(read)))
        return table

    assert "number of points that neither repeat nor interpolate others" in error_of(change)


def test_a_ratio_must_be_a_mean(error_of):
    message = error_of(lambda t: t.assign(**{"quantity": "ratio", "statistic": "min", "unit": "1"}))
    assert "line 2: statistic = 'min'" in message and "use mean" in message


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda t: t.assign(time=1000.0 * t.time), "give one beat with times in s"),
        (lambda t: t.astype({"value": object}).replace({"value": {t.value[7]: "12,5"}}), "line 9: value"),
        (
            lambda t: t.drop(columns="sd"),
            "sd: column missing; the file has condition, quantity, location, statistic, time, value, unit\n",
        ),
        (lambda t: t.assign(sd=-t.sd), "line 2: sd"),
        (lambda t: t.replace("hyperaemia", "hyperemia"), "not in the conditions file; known: rest, hyperaemia"),
        (lambda t: t.replace("mean", "average"), "statistic"),
        (lambda t: t[:0], "contains no measurements"),
        (lambda t: pd.concat([t, t[t.statistic == "mean"]]), ": the same measurement; keep one row"),
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
def test_an_invalid_table_is_rejected(error_of, change, text):
    assert text in error_of(change)


def read_changed(folder, tmp_path, change):
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
def test_the_spelling_of_a_table_does_not_matter(stenosis_case, tmp_path, change):
    problem = read_changed(stenosis_case[0], tmp_path, change)
    plain = read_changed(stenosis_case[0], tmp_path, lambda t: t)
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


def test_series_are_in_the_order_of_the_conditions_file(stenosis_case, tmp_path):
    """That is the order in which a sensor drifts, whatever the order of rows."""
    shuffled = read_changed(stenosis_case[0], tmp_path, lambda t: t.sample(frac=1.0, random_state=2))
    order = list(dict.fromkeys(one.condition for one in shuffled.forward.measured))
    assert order == list(shuffled.forward.conditions) and len(order) > 2


def test_a_condition_name_may_consist_of_digits(tmp_path):
    rows = ["condition,quantity,location,statistic,time,value,sd,unit", "01,flow,A:B,mean,,1.0,0.1,mL/s"]
    (tmp_path / "measurements.csv").write_text("\n".join(rows) + "\n")
    table = read_table(tmp_path / "measurements.csv")
    assert table["condition"].tolist() == ["01"] and table["value"].tolist() == [1.0]
