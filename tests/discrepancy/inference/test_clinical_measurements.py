"""What a clinic measures at rest and stress is predicted by a case's closed loop, and tested against it."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.cli.check import check
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.inference.locate import locate
from coronaryuq.discrepancy.inference.read_problem import make_problem, read_series, with_time_steps
from coronaryuq.discrepancy.settings import Settings
from support.case_files import CLINICAL, clinical_table, small_tree, write_case

pytestmark = pytest.mark.slow
ROWS = {"cuff": 2, "phase-contrast": 2, "Doppler": 1, "perfusion": 2}


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """The problem of a case whose measurements are its own predictions."""
    folder = tmp_path_factory.mktemp("case")
    network = check(write_case(folder, small_tree())).case.network
    (folder / "m.csv").write_text(clinical_table())
    (folder / "c.yaml").write_text("rest:\nstress: {coronary_resistance_scale: 0.3}\n")
    conditions = read_conditions(folder / "c.yaml")
    series = read_series(network, folder / "m.csv", conditions, folder / "c.yaml")
    settings = Settings(steps_per_cycle=200)
    blank = make_problem(network, conditions, series, settings)
    values = blank.forward.split(blank.forward.predict(np.zeros(blank.count)))
    exact = [replace(one, value=own[0], sd=0.05 * np.maximum(np.abs(own[0]), one.sd)) for one, own in
             zip(blank.forward.measured, values, strict=True)]  # fmt: skip
    return network, conditions, exact, settings


def alarm(network, conditions, series, settings):
    problem = with_time_steps(make_problem(network, conditions, series, settings))
    return locate(problem, problem.calibrate(PLAIN)).alarm(0.01)


def test_a_right_model_agrees_with_all_of_them(measured):
    assert sum(ROWS.values()) == sum(map(len, CLINICAL.values()))
    assert not alarm(*measured)


@pytest.mark.parametrize("kind", [*CLINICAL, "pullback"])
def test_each_of_them_can_contradict_the_model(kind, measured):
    """Under stress alone, in opposite directions where there are two: no recalibration explains that."""
    network, conditions, series, settings = measured
    first = {name: sum(list(ROWS.values())[:number]) for number, name in enumerate(ROWS)}
    stress = [number for number, one in enumerate(series) if one.condition == "stress"]
    own = stress[first[kind] : first[kind] + ROWS[kind]] if kind in ROWS else [
        number for number in stress if series[number].quantity == "pullback ratio"]  # fmt: skip
    spoilt = list(series)
    for sign, number in zip((1.0, -1.0), own, strict=False):
        wave = np.linspace(-1.0, 1.0, spoilt[number].value.size) if kind == "pullback" else 1.0
        spoilt[number] = replace(spoilt[number], value=spoilt[number].value + 14.0 * sign * wave * spoilt[number].sd)
    assert own and alarm(network, conditions, spoilt, settings)
