"""Patients of the benchmark: within the stated ranges, reproducible, with errors of the stated size."""

import numpy as np
import pytest

from coronaryuq.bench.endtoend import patients
from coronaryuq.bench.endtoend.data import PRESSURES, measured, write_measured
from coronaryuq.bench.endtoend.patients import Errors, draw
from coronaryuq.case.assembly import assemble
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.case.settings import Settings as CaseSettings
from coronaryuq.core.seeds import generator
from coronaryuq.core.units import BLOOD_VISCOSITY, MMHG
from coronaryuq.synthetic.truth import HEART, patient_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def drawn():
    return [draw(1, index) for index in range(8)]


def test_what_is_drawn_lies_within_the_stated_ranges(drawn):
    for one in drawn:
        assert 0 <= len(one.lesions) <= 3 and len({lesion.name for lesion in one.lesions}) == len(one.lesions)
        for lesion in one.lesions:
            assert patients.REDUCTION[0] <= lesion.reduction <= patients.REDUCTION[1]
            assert patients.LENGTH[0] <= lesion.length <= patients.LENGTH[1]
        values = one.settings.model_dump()
        for name, (low, high) in patients.UNIFORM.items():
            assert low <= values[name] <= high
        assert all(
            patients.MICROVASCULAR[0] <= v <= patients.MICROVASCULAR[1] for v in values["microvascular"].values()
        )
        assert {outlet.branch for outlet in one.true.outlets} == {"LAD", "LCx", "RCA"}
    assert len({one.settings.anatomy_seed for one in drawn}) == len(drawn)


def test_the_segmented_throat_has_the_drawn_severity(drawn):
    for one in drawn:
        for lesion, stenosis in zip(one.lesions, one.segmented.stenoses, strict=True):
            vessel = one.segmented.tree[stenosis.vessel]
            middle = (stenosis.start + stenosis.end) / 2
            ends = (vessel.radius_at(stenosis.start) + vessel.radius_at(stenosis.end)) / 2
            assert vessel.radius_at(middle) / ends == pytest.approx(1 - lesion.reduction, abs=0.02)


def test_the_same_seed_and_index_give_the_same_bits_and_others_do_not(drawn):
    again, other = draw(1, 3), draw(2, 3)
    for one, vessel in zip(drawn[3].true.tree, again.true.tree, strict=True):
        assert one.radii.tobytes() == vessel.radii.tobytes() and one.points.tobytes() == vessel.points.tobytes()
    assert again.stated() == drawn[3].stated() != other.stated()
    assert dict(again.physics.heart) == dict(drawn[3].physics.heart) != dict(HEART)


def test_without_noise_the_lumen_and_all_assumptions_are_the_truth():
    one = draw(1, 1, noise=0.0)
    for segmented, true in zip(one.segmented.tree, one.true.tree, strict=True):
        assert np.allclose(segmented.radius_at(true.arc), true.radii, rtol=1e-12, atol=0.0)
    assert (one.settings.hyperaemia, one.physics.viscosity) == (0.24, BLOOD_VISCOSITY)
    stated = one.errors.routine.model_dump(
        exclude={"pressure_correlation", "microvascular", "microvascular_correlation"}
    )
    assert not any(stated.values())
    # Beds of one heart differ, however well they are measured.
    assert one.errors.routine.microvascular == RoutineErrors().microvascular > 0


@pytest.mark.long
def test_the_true_lumen_has_the_stated_mean_and_spread_at_a_throat():
    trials = [draw(7, index) for index in range(60)]
    scores = []
    for one in trials:
        for stenosis in one.segmented.stenoses:
            at = (stenosis.start + stenosis.end) / 2
            radius = one.segmented.tree[stenosis.vessel].radius_at(at)
            lost = 1 - radius / one.segmented.tree[stenosis.vessel].radius_at(stenosis.start)
            lumen = one.errors.lumen
            sd = lumen.scale * np.hypot(lumen.common_sd, lumen.local_sd * (1 + lumen.narrow * lost))
            spread = np.sqrt(np.log1p((sd / radius) ** 2))
            scores.append((np.log(one.true.tree[stenosis.vessel].radius_at(at) / radius) + spread**2 / 2) / spread)
    n = len(scores)
    assert n > 60
    # Vessels of one patient share a part of the error, a ninth to a fifth of its variance.
    assert abs(np.mean(scores)) < 4 * np.sqrt(1.5 / n)
    assert abs(np.std(scores) - 1) < 4 * np.sqrt(1.5 / (2 * n))


def test_cuff_and_echo_have_the_stated_errors():
    truth = {"PaoMin": 70 * MMHG, "PaoMean": 93 * MMHG, "PaoMax": 120 * MMHG, "AbsQin": 70.0}
    truth |= {"EDV": 110.0, "ESV": 40.0, "EFLV": 0.62, "AorCorSplit": 4.0, "QlaRatio": 1.2}
    random, errors, trials = generator(1, "tests", "endtoend", "cuff"), RoutineErrors(), 4000
    found = [measured(truth, errors, random) for _ in range(trials)]
    table = {name: np.array([one[name] for one in found]) for name in truth}
    expected = dict.fromkeys(PRESSURES, errors.pressure * MMHG) | {"EFLV": errors.ejection_fraction}
    expected |= {"AbsQin": 0.12 * 70, "EDV": 0.12 * 110, "ESV": 0.12 * 40}
    for name, sd in expected.items():
        assert abs(table[name].std() / sd - 1) < 4 / np.sqrt(2 * trials)
        assert abs(table[name].mean() - truth[name]) < 4 * sd / np.sqrt(trials)
    assert (table["QlaRatio"] == 1.2).all()
    rho = errors.pressure_correlation
    correlation = np.corrcoef(table["PaoMin"], table["PaoMax"])[0, 1]
    assert abs(correlation - rho) < 4 * (1 - rho**2) / np.sqrt(trials)
    assert measured(truth, Errors.scaled(0.0).routine, random) == truth


def test_the_case_is_read_as_a_real_one_and_holds_the_segmented_lumen(drawn, tmp_path):
    one = next(one for one in drawn if one.lesions)
    truth = patient_of(one.true, one.settings, one.seed, one.physics)
    write_measured(one, truth, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "case.yaml", "lv.vtu", "outlets.csv", "targets.csv", "tree.vtp",
    ]  # fmt: skip
    case = assemble(tmp_path / "case.yaml", CaseSettings(), "full")
    assert {s.name for s in case.stenoses} == {lesion.name for lesion in one.lesions}
    for vessel in one.segmented.tree:
        assert np.allclose(case.tree[vessel.name].radii, vessel.radii, rtol=1e-6)
    assert case.summary.hyperaemia == 0.24 and case.summary.errors == one.errors.routine
