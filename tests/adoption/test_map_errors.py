"""Errors of the perfusion map that a search named are undone in the target flows; other errors leave these alone."""

import numpy as np
import pytest

from coronaryuq.adoption.choice import Placed
from coronaryuq.adoption.map_errors import BEYOND, NOT_STATED, OF_MAP, readings_of_map, without_map_errors
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.perfusion.targets import read_perfusion_targets, supplied
from coronaryuq.zerod.effects.library import effect
from support.adopted_effects import placed
from support.case_files import write_perfusion_targets

BEDS = ["BC_a", "BC_b", "BC_c"]
TRUE = {"rest": np.array([1.0, 0.8, 1.2]) / 60.0, "hyperaemia": np.array([3.0, 1.4, 2.6]) / 60.0}
MASS = np.array([40.0, 30.0, 20.0])
ERRORS = {
    "mbf_underestimation": ("perfusion map", {"saturation": 0.3}),
    "shifted_territory": ("BC_a<BC_b", {"share": 0.25}),
    "rotated_territories": ("perfusion map", {"share": -0.2}),
}


def series(values):
    return [
        Measured(condition, "perfusion", bed, "mean", None, 1.0, np.array([value]), np.array([0.1 * value]))
        for condition, row in values.items()
        for bed, value in zip(BEDS, row, strict=True)
    ]


def read(name, true=TRUE, sizes=None):
    """What the map reads with the error: condition → (3,)."""
    place, own = ERRORS[name]
    sizes = {key: np.array([value]) for key, value in (sizes or own).items()}
    flat = np.concatenate(list(true.values()))
    seen = np.hstack(effect(name).observe(place, sizes, series(true), [np.array([[value]]) for value in flat]))[0]
    return dict(zip(true, np.split(seen, len(true)), strict=True))


def named(name, probability=1.0, sd=1e-6):
    place, sizes = ERRORS[name]
    mean = [float(parameter.to_standard(sizes[parameter.name])) for parameter in effect(name).parameters]
    return Placed(name, place, probability, True, mean, [[sd**2]])


def targets_of(values, tmp_path, covariance=None):
    return read_perfusion_targets(
        write_perfusion_targets(tmp_path / "targets.json", BEDS, values["hyperaemia"] * MASS, covariance)
    )


def of_map(values):
    return readings_of_map(series(values), "hyperaemia", BEDS)


@pytest.mark.parametrize("name", ERRORS)
def test_the_targets_are_those_of_a_map_without_the_error(name, tmp_path):
    measured = read(name)
    targets = targets_of(measured, tmp_path)
    found = without_map_errors(targets, [[named(name)]], of_map(measured))
    assert np.abs(targets.mean / (TRUE["hyperaemia"] * MASS) - 1.0).max() > 0.05
    assert found.targets.mean == pytest.approx(TRUE["hyperaemia"] * MASS, rel=1e-6)
    assert supplied(found.targets) == pytest.approx(supplied(targets)), "the tissue is the same"
    assert found.became == {named(name).label: OF_MAP}


@pytest.mark.parametrize("name", ERRORS)
def test_their_covariance_is_that_of_noise_and_size_carried_through(name, tmp_path):
    """Against inversions of noisy maps with other sizes, which are small enough for the first order."""
    measured, random = read(name), np.random.default_rng(1)
    noise, sd, n = 0.004, 0.02, 400
    covariance = np.diag((noise * measured["hyperaemia"] * MASS) ** 2)
    targets = targets_of(measured, tmp_path, covariance)
    found = without_map_errors(targets, [[named(name, sd=sd)]], of_map(measured))
    drawn = []
    for _ in range(n):
        noisy = measured | {"hyperaemia": measured["hyperaemia"] * (1.0 + noise * random.standard_normal(3))}
        one = named(name)
        moved = Placed(one.effect, one.place, 1.0, True, [one.mean[0] + sd * random.standard_normal()], one.covariance)
        seen = targets.model_copy(update={"mean": noisy["hyperaemia"] * MASS})
        drawn.append(without_map_errors(seen, [[moved]], of_map(noisy)).targets.mean)
    sampled = np.cov(np.array(drawn), rowvar=False)
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    assert np.abs((found.targets.covariance - sampled) / scale).max() < 4.0 * np.sqrt(2.0 / n)
    assert found.targets.relative_sd == pytest.approx(np.sqrt(np.diag(found.targets.covariance)) / found.targets.mean)


def test_a_class_with_another_effect_gives_the_mixture_of_both(tmp_path):
    measured = read("mbf_underestimation")
    targets = targets_of(measured, tmp_path)
    leak = placed("side_branch_leak", probability=0.4)
    found = without_map_errors(targets, [[named("mbf_underestimation", 0.6), leak]], of_map(measured)).targets
    true = TRUE["hyperaemia"] * MASS
    assert found.mean == pytest.approx(0.6 * true + 0.4 * targets.mean, rel=1e-6)
    between = 0.6 * 0.4 * (true - targets.mean) ** 2
    assert (np.diag(found.covariance) > np.diag(targets.covariance) + between).all()


def test_errors_of_other_instruments_leave_the_targets_alone(tmp_path):
    measured = read("mbf_underestimation")
    targets = targets_of(measured, tmp_path)
    gain = Placed("flow_gain", "J0:lca1", 1.0, True, [0.5], [[0.01]])
    found = without_map_errors(targets, [[gain], [placed("side_branch_leak")]], of_map(measured))
    assert found.targets is targets and not found.became


def test_without_readings_of_the_map_the_targets_stay_and_the_page_says_why(tmp_path):
    targets = targets_of(TRUE, tmp_path)
    found = without_map_errors(targets, [[named("mbf_underestimation")]], None)
    assert found.targets is targets and found.became == {named("mbf_underestimation").label: NOT_STATED}


def test_readings_that_no_flow_gives_leave_the_targets_alone(tmp_path):
    """Above what tracer extraction lets a map show."""
    beyond = {"rest": TRUE["rest"], "hyperaemia": 10.0 * TRUE["hyperaemia"]}
    targets = targets_of(beyond, tmp_path)
    found = without_map_errors(targets, [[named("mbf_underestimation")]], of_map(beyond))
    assert found.targets is targets and found.became == {named("mbf_underestimation").label: BEYOND}


def test_a_bed_without_a_reading_is_an_input_error():
    with pytest.raises(InputError, match="no mean perfusion of BC_d under it"):
        readings_of_map(series(TRUE), "hyperaemia", [*BEDS, "BC_d"])
