"""What should not matter does not: order, sampling, units, held-out condition, outliers, misstated noise."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import analyse, hide
from coronaryuq.core.seeds import generator
from coronaryuq.zerod.effects.base import Z_90

Table = pd.DataFrame
WAVES = "waveform"


def reversed_rows(table: Table) -> Table:
    return table.iloc[::-1]


def every_second_sample(table: Table) -> Table:
    number = table.groupby(["condition", "quantity", "location", "statistic"]).cumcount()
    return table[(table["statistic"] != WAVES) | (number % 2 == 0)]


def interpolated(table: Table) -> Table:
    """Twice the samples of every waveform, of which every second one is the mean of its neighbours."""
    keys, found = ["condition", "quantity", "location", "statistic"], []
    for (*_, statistic), own in table.groupby(keys, sort=False):
        between = own.copy()
        for name in ("time", "value"):
            between[name] = 0.5 * (own[name] + own[name].shift(-1))
        found.append(pd.concat([own, between[between["time"].notna()]]) if statistic == WAVES else own)
    return pd.concat(found)


def in_mmhg(table: Table) -> Table:
    table, pressure = table.copy(), table["unit"] == "dyn/cm2"
    table.loc[pressure, ["value", "sd"]] /= 1333.22387415
    table.loc[pressure, "unit"] = "mmHg"
    return table


def with_outliers(table: Table) -> Table:
    """One per cent of the samples off by twelve standard deviations."""
    table, random = table.copy(), generator(1, "test", "outliers")
    waves = np.flatnonzero(table["statistic"] == WAVES)
    rows = random.choice(waves, max(1, len(waves) // 100), replace=False)
    column = table.columns.get_loc("value")
    table.iloc[rows, column] += 12.0 * random.choice([-1.0, 1.0], len(rows)) * table["sd"].to_numpy()[rows]
    return table


def turned_conditions(folder: Path) -> None:
    path = folder / "conditions.yaml"
    first, *others = yaml.safe_load(path.read_text()).items()
    path.write_text(yaml.safe_dump(dict([first, *reversed(others)]), sort_keys=False))


def another_held_out(folder: Path) -> None:
    path = folder / "conditions.yaml"
    entries = yaml.safe_load(path.read_text())
    entries["half dilated"].pop("held_out")
    entries["pacing"]["held_out"] = True
    path.write_text(yaml.safe_dump(entries, sort_keys=False))


TABLES: dict[str, Callable[[Table], Table]] = {
    "rows": reversed_rows,
    "sampling": every_second_sample,
    "interpolation": interpolated,
    "units": in_mmhg,
    "outliers": with_outliers,
}
FOLDERS: dict[str, Callable[[Path], None]] = {"conditions": turned_conditions, "held out": another_held_out}
CASES = [
    Case(("quadratic_stenosis",), "medium", "nominal", 100),
    Case(("intramyocardial_pressure",), "medium", "nominal", 100),
    Case(("flow_gain",), "medium", "nominal", 100),
    Case((), "medium", "nominal", 100, "drifting_vessel"),
    Case((), "none", "nominal", 100),
]
MORE = [
    *(Case((name,), "medium", "nominal", 101) for name in ("pressure_offset", "flow_delay", "drive_gain")),
    Case((), "medium", "nominal", 101, "miswired_outlets"),
    Case(("diffuse_narrowing", "pressure_gain"), "medium", "nominal", 101),
]


def answered(folder: Path) -> tuple[str, dict]:
    """The answer, and the interval of the first size of each named effect."""
    found = analyse(folder)
    sizes = {placed: found.sizes(placed)[0][1:] for placed in (entry.named.placed for entry in found.named)}
    return ("nothing" if found.consistent else found.answer.given), {
        (placed.effect.name, placed.place): (z - Z_90 * sd, z + Z_90 * sd) for placed, (z, sd) in sizes.items()
    }


def same(folder: Path, case: Case) -> None:
    hide(case, open_loop(), folder)
    table = pd.read_csv(folder / "measurements.csv")
    conditions = (folder / "conditions.yaml").read_text()
    answer, intervals = answered(folder)
    for name in (*TABLES, *FOLDERS):
        if name in TABLES:
            TABLES[name](table).to_csv(folder / "measurements.csv", index=False)
        else:
            FOLDERS[name](folder)
        other, others = answered(folder)
        assert (other, set(others)) == (answer, set(intervals)), name
        for key, (low, high) in intervals.items():
            assert max(low, others[key][0]) < min(high, others[key][1]), (name, key)
        table.to_csv(folder / "measurements.csv", index=False)
        (folder / "conditions.yaml").write_text(conditions)


@pytest.mark.long
@pytest.mark.parametrize("case", [*CASES, *MORE], ids=lambda case: case.label)
def test_the_answer_is_the_same(case, tmp_path):
    same(tmp_path, case)


@pytest.mark.long
@pytest.mark.parametrize("effects", [(), ("quadratic_stenosis",)], ids=["nothing", "stenosis"])
def test_understated_and_lasting_noise_together_are_seen(effects, tmp_path):
    """Standard deviations of two thirds of the true ones, and a correlation of 0.7 of successive samples."""
    truth, _ = hide(Case(effects, "medium", "correlated", 100), open_loop(), tmp_path)
    table = pd.read_csv(tmp_path / "measurements.csv")
    table["sd"] *= 2.0 / 3.0
    table.to_csv(tmp_path / "measurements.csv", index=False)
    found = analyse(tmp_path)
    assert found.consistent is not bool(effects)
    assert list(found.hypothesis) == (list(truth.hypothesis) if effects else list(found.hypothesis))
    assert all(entry.correlation_time > 0.0 for entry in found.noise.values()) and len(found.noise) == 2
