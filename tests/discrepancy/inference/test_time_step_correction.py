"""The time-step correction at a fit: an effect may change what the time steps do to predictions."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import hide
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.inference import read_problem as reading
from coronaryuq.discrepancy.inference.read_problem import with_time_steps
from coronaryuq.discrepancy.inference.time_step_error import FINER
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import COMPLIANCES, RESISTANCES
from coronaryuq.zerod.network.read import read_network
from support.hypotheses import assume
from support.small_loop import fresh

COARSE = 50
"""Time steps a cycle with which waveforms of this tree are well off."""
STORE = assume(("epicardial_compliance", "lad"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("case")
    hide(Case((), "none", "nominal", 5), open_loop(), folder)
    return folder


def problem(folder, steps):
    conditions = read_conditions(folder / "conditions.yaml")
    settings, network = Settings(steps_per_cycle=steps), read_network(folder / "model.json")
    with pytest.MonkeyPatch.context() as patch:
        # As in a closed loop, which keeps its steps.
        patch.setattr(reading, "SHORT", 0)
        return reading.read_problem(network, folder / "measurements.csv", conditions, "c", settings)


def with_store(folder):
    """A problem with coarse steps, whose data are those of the same model with shorter ones and a store in a vessel."""
    coarse, fine = problem(folder, COARSE), problem(folder, FINER * COARSE)
    plain = [nuisance for nuisance in fine.forward.nuisances if nuisance.shape is None]
    truth = np.append(0.3 * np.ones(len(plain)), 1.5)
    (data,) = replace(fine.forward, nuisances=plain, shapes=None).predict(truth, STORE)
    series = coarse.forward.measured
    read = coarse.forward.split(data[None, :])
    measured = [replace(one, value=values[0]) for one, values in zip(series, read, strict=True)]
    return replace(coarse, forward=replace(coarse.forward, measured=measured)), truth[-1]


@pytest.mark.slow
def test_a_size_biased_by_coarse_steps_is_right_after_the_correction(folder):
    """To within a fifth of the bias; the data have no noise, so that nothing but priors keeps a fit from them."""
    coarse, size = with_store(folder)
    fit = coarse.calibrate(STORE)
    corrected, better = coarse.corrected(STORE, fit)
    before, after = (abs(one.z[-1] - size) / np.sqrt(one.covariance[-1, -1]) for one in (fit, better))
    assert before > 4.0 * RULE.time_step_error and after < 0.2 * before
    assert np.linalg.norm(better.residual) < 0.1 * np.linalg.norm(fit.residual)
    # Parts of beds, of which several have nearly the same effect, may move.
    parts = {*RESISTANCES, *COMPLIANCES}
    known = [(column, one) for column, one in enumerate(coarse.forward.nuisances) if one.shape is None]
    own = [column for column, one in known if one.name.split()[0] not in parts]
    assert better.z[own] == pytest.approx(fit.z[own], abs=0.3) and corrected.sd == pytest.approx(coarse.sd, rel=0)


def test_an_error_within_the_allowances_is_not_corrected(folder):
    fine = problem(folder, Settings().steps_per_cycle)
    fit = fine.calibrate(assume())
    same, kept = fine.corrected(assume(), fit)
    assert same is fine and kept is fit


@pytest.mark.slow
def test_runs_with_shorter_steps_change_no_digit_of_later_runs():
    """A closed loop starts where it settled before: what is met while looking must not serve."""
    looked, other = with_time_steps(fresh()), with_time_steps(fresh())
    z = 0.4 * np.ones(looked.count)
    assert np.isfinite(looked.time_step_change([(z, assume())])).all()
    assert (looked.whitened([(z, assume())]) == other.whitened([(z, assume())])).all()
