"""Predictions of many rows at once are those of each alone: shared networks, shared runs, carried-over states."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import hide
from coronaryuq.core.provenance import closure
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.forward import hypothesis, predict
from coronaryuq.discrepancy.forward.hypothesis import shared_grafts
from coronaryuq.discrepancy.inference.read_problem import read_problem
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.library import LIBRARY, effect
from coronaryuq.zerod.network.read import read_network
from support.hypotheses import assume, placed


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    folder = tmp_path_factory.mktemp("case")
    hide(Case((), "none", "nominal", 5), open_loop(), folder)
    conditions = read_conditions(folder / "conditions.yaml")
    return read_problem(read_network(folder / "model.json"), folder / "measurements.csv", conditions, "c", Settings())


LEAKS = [placed("side_branch_leak", place) for place in ("lad", "lcx", "lad_proximal")]
COLLATERAL = placed("collateral", "lad~lcx")
LOSSES = [placed("quadratic_stenosis", "lad"), placed("bifurcation_loss", "lad_proximal")]


@pytest.mark.parametrize("one", [LEAKS[0], LEAKS[2], COLLATERAL, *LOSSES], ids=lambda one: f"{one[0].name}@{one[1]}")
def test_a_network_with_all_grafts_predicts_the_same_as_one_with_its_own(problem, one):
    z = np.append(0.3 * np.ones(problem.count), 0.0)
    rows = [(z, assume(one)), (z[:-1], assume())]
    alone = problem.forward.predict_rows(rows)
    together = problem.forward.predict_rows(rows, None, [*LEAKS, COLLATERAL, *LOSSES])
    difference = np.abs((together - alone) / problem.sd).max()
    assert difference < 0.05
    assert np.abs((alone[0] - alone[1]) / problem.sd).max() > 10.0 * difference


def test_only_a_few_collaterals_share_a_network(problem, monkeypatch):
    """Each is predicted as by itself, whichever network it is in; leaks stay together."""
    monkeypatch.setattr(hypothesis, "MANY", 2)
    collateral = effect("collateral")
    ends = [placed(collateral, place) for place in collateral.places(problem.forward.anatomy)]
    branches = [placed("side_branch", place) for place in ("lad", "lcx", "lad_proximal")]
    shares = shared_grafts([*LEAKS, *branches, *ends])
    assert shares[branches[0]] == branches[:2] and shares[branches[2]] == branches[2:], "apart from leaks"
    shares = shared_grafts([*LEAKS, *ends])
    assert set(shares) == {*LEAKS, *ends} and all(one in share for one, share in shares.items())
    assert all(set(LEAKS) <= set(shares[one]) for one in LEAKS)
    sizes = {len([one for one in share if one[0] is collateral]) for share in shares.values()}
    assert max(sizes) == 2 and len(ends) > 2
    z = np.append(np.zeros(problem.count), 0.0)
    rows = [(z, assume(one)) for one in ends]
    together = problem.forward.predict_rows(rows, None, [*LEAKS, *ends])
    for row, found in zip(rows, together, strict=True):
        assert np.abs((problem.forward.predict_rows([row])[0] - found) / problem.sd).max() < 0.05


def test_rows_do_not_depend_on_other_rows(problem):
    z = 0.2 * np.ones(problem.count)
    many = [
        (np.append(z, 0.5), assume(("quadratic_stenosis", "lcx"))),
        (np.append(z, 0.5), assume(("intramyocardial_pressure", "all beds"))),
        (np.append(z, 0.5), assume(("flow_gain", "lcx:BC_lcx"))),
        (z, assume()),
    ]
    together = problem.forward.predict_rows(many)
    for row, found in zip(many, together, strict=True):
        assert np.abs((problem.forward.predict_rows([row])[0] - found) / problem.sd).max() < 0.02


def test_only_the_requested_conditions_are_run(problem):
    before = problem.forward.simulation.runs
    found = problem.forward.predict_rows([(np.zeros(problem.count), assume())], {"rest", "pacing"})[0]
    assert problem.forward.simulation.runs - before == 2
    asked = np.isin(problem.condition, ["rest", "pacing"])
    assert np.isfinite(found[asked]).all() and np.isnan(found[~asked]).all()


def test_an_error_of_the_perfusion_map_uses_all_conditions(problem):
    """Renkin and Crone's loss is relative to the least flow of all conditions, also where one of them is not fitted."""
    row = (np.append(np.zeros(problem.count), 0.0), assume(("mbf_underestimation", "perfusion map")))
    some = problem.forward.predict_rows([row], {"hyperaemia"})[0]
    assert some == pytest.approx(problem.forward.predict_rows([row])[0])


ON_READINGS = [one for one in LIBRARY if one.side == "measurement"]


@pytest.mark.parametrize("one", ON_READINGS, ids=lambda one: one.name)
def test_an_error_of_readings_is_predicted_without_the_conditions_it_does_not_need(problem, one):
    """Offsets, relative to the mean of all readings, and an underestimated perfusion alone need other conditions."""
    places = one.places(problem.forward.anatomy, problem.forward.measured)
    if not places:
        pytest.skip("acts nowhere in this case")
    before = problem.forward.simulation.runs
    row = (np.append(0.2 * np.ones(problem.count), 0.7 * np.ones(len(one.parameters))), assume(placed(one, places[0])))
    found = problem.fitted([row])[0]
    assert problem.forward.simulation.runs - before == (4 if one.across_conditions else 3)
    assert np.isfinite(found).all()
    assert found.tolist() == problem.whitened([row])[0][problem.train].tolist()


def test_no_prediction_depends_on_what_runs_beside_it(problem):
    """A gain of the driving pressure, for one, resamples its waveform; the runs beside it keep their own."""
    random = generator(1, "test", "beside")
    acting = [(one, one.places(problem.forward.anatomy, problem.forward.measured)) for one in LIBRARY]
    rows = [
        (0.5 * random.standard_normal(problem.count + len(one.parameters)), assume(placed(one, places[0])))
        for one, places in acting
        if places
    ]
    assert len(rows) > 30
    together, alone = problem.fitted(rows), np.array([problem.fitted([row])[0] for row in rows])
    assert np.isfinite(together).all()
    assert np.abs(together - alone).max() < 1e-6


def test_an_effect_with_feedback_fails_if_an_earlier_run_failed(problem, monkeypatch):
    """And leaves the other rows of its batch as they are alone."""
    rows = [(np.append(k * np.ones(problem.count), 1.0), assume(("autoregulation", "all beds"))) for k in (0.1, 0.2)]
    alone = problem.forward.predict_rows(rows[1:])[0]
    simulation, calls = problem.forward.simulation, []

    def fails_once(prepared, jobs, names, tolerance):
        waves = yield from run(prepared, jobs, names, tolerance)
        if not calls:
            for wave in waves.values():
                wave[0] = np.nan
        calls.append(len(jobs))
        return waves

    run = simulation.waveforms
    monkeypatch.setattr(simulation, "waveforms", fails_once)
    first, second = problem.forward.predict_rows(rows)
    assert len(calls) > 1
    assert not np.isfinite(first).all()
    assert second == pytest.approx(alone, rel=1e-9)


def test_the_time_step_error_is_corrected(problem):
    """Against steps a tenth as long, at a point of their own: the change leaves less than half of the difference.

    What it leaves of each series, along whatever shape, is within three of the standard deviations that go with it.
    """
    predict, steps = problem.forward, problem.time_steps
    finer = replace(predict, simulation=predict.simulation.changed(steps_per_cycle=3000))
    z = 0.3 * np.ones(problem.count)
    difference = (finer.predict(z) - predict.predict(z))[0]
    left = difference - steps.change
    assert np.linalg.norm(left / problem.sd) < np.linalg.norm(difference / problem.sd) / 2.0
    for of, said in zip(predict.split(left[None, :]), predict.split(steps.sd[None, :]), strict=True):
        assert np.linalg.norm(of) < 3.0 * said.max()


def test_the_search_does_not_import_the_generator():
    """What analyses a case imports neither the generator of hidden effects nor the benchmark that scores it."""
    behind = closure("coronaryuq.discrepancy.search_case")
    assert "coronaryuq.discrepancy.selection.search" in behind
    assert not [name for name in behind if name.startswith(("coronaryuq.discrepancy.hidden", "coronaryuq.bench"))]


def test_values_set_by_an_effect_are_computed_once_for_all_nuisance_parameters(problem, monkeypatch):
    """Per condition and size; the predictions are those of each row alone."""
    one, computed = LOSSES[0], []

    def counted(self, prepared, name, hypothesis, sizes, pressures):
        computed.append((name, *sizes[0].values()))
        return own(self, prepared, name, hypothesis, sizes, pressures)

    own = predict.Forward.effect_values
    monkeypatch.setattr(predict.Forward, "effect_values", counted)
    steps = 0.1 * np.eye(problem.count + 1)
    rows = [(row, assume(one)) for row in np.vstack([np.zeros(problem.count + 1), steps])]
    together = problem.forward.predict_rows(rows)
    assert len(computed) == len(set(computed)) == 2 * len(problem.forward.conditions), "two sizes"
    alone = np.array([problem.forward.predict_rows([row])[0] for row in rows])
    assert np.abs((together - alone) / problem.sd).max() < 1e-6
