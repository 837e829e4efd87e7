"""Runs of a closed loop begun at a neighbour's periodic state are those begun at the model's own: the same blood."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.simulation import LOOSE
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.solver.warm_starts import MOST, OTHER_EFFECT, KnownStates, Point, Structure, WarmStarts
from support.hypotheses import assume
from support.small_loop import STENOSIS, fresh


@pytest.fixture(scope="module")
def problem():
    return fresh()


def row(problem, shift):
    z = np.where([n.mass is None for n in problem.forward.nuisances], 1.0 + shift, 0.0)
    return np.append(z, 0.3), assume(STENOSIS)


def test_a_warm_start_does_not_change_the_result(problem):
    """Compliances, resistances and the heart moved: predictions from next door are those from far away."""
    wanted = fresh().forward.predict_rows([row(problem, 0.0)])[0]
    problem.forward.predict_rows([row(problem, -0.4)])
    again = problem.forward.predict_rows([row(problem, 0.0)])[0]
    neighbour = problem.forward.predict_rows([row(problem, -0.4)])[0]
    size = np.abs(wanted).max()
    # Valves that open a step earlier or later leave a cycle error of up to `LOOSE`.
    assert np.abs(again - wanted).max() / size < LOOSE
    assert np.abs(neighbour - wanted).max() / size > 1e-2, "the neighbour is another point"


@pytest.mark.long
def test_fits_in_lockstep_do_not_depend_on_threads():
    """Several networks with what each has met: the same bits; and near what each fit finds by itself."""
    leak, blood = (effect("side_branch_leak"), "lca2"), (effect("haematocrit"), "everywhere")
    acting = [assume(), assume(STENOSIS), assume(STENOSIS, leak), assume(blood)]

    def problem(threads):
        made = fresh(threads=threads)
        made.y = made.forward.predict_rows([row(made, -0.3)])[0]
        largest = [np.abs(values).max() for values in made.forward.split(made.y[None, :])]
        made.sd = 0.02 * np.array(largest)[made.owner]
        return made

    one, *more = ([problem(threads).calibrate_each([(each, None) for each in acting])] for threads in (1, 2, 3))
    for other in more:
        for mine, its in zip(*one, *other, strict=True):
            assert np.array_equal(mine.z, its.z) and np.array_equal(mine.residual, its.residual)
    for each, mine in zip(acting, *one, strict=True):
        assert problem(1).calibrate(each).evidence == pytest.approx(mine.evidence, abs=0.1)


def test_a_warm_start_has_the_required_blood_volume(problem):
    """A state of the plain loop for one with a stenosis put in, with other compliances."""
    forward = problem.forward
    plain, grafted = forward.simulation.prepared([]), forward.simulation.prepared(assume(STENOSIS))
    starts, known = WarmStarts(), Point(np.full(problem.count, 0.5), {})
    state = plain.start["rest"].copy()
    state[plain.engine.state_names.index("V_LV:CLH")] += 7.0
    starts.keep("rest", known, plain.structure, state)
    own = np.array([grafted.start["rest"]])
    changes = {"BC_RCR1.C": np.array([1.3 * grafted.values["rest"]["BC_RCR1.C"]])}
    structure = Structure(grafted.engine, grafted.renamed)
    found = starts.near([("rest", Point(np.full(problem.count, 0.6), {}))], structure, own, changes)
    volume = BloodVolume(grafted.engine.model)
    assert volume.evaluate(found, changes)[0] == pytest.approx(volume.evaluate(own, changes)[0], rel=1e-12)
    names = grafted.engine.state_names
    assert found[0, names.index("V_LV:CLH")] == pytest.approx(own[0, names.index("V_LV:CLH")] + 7.0)


def test_far_points_start_at_the_state_of_the_unmodified_model(problem):
    forward = problem.forward
    plain = forward.simulation.prepared([])
    starts = WarmStarts()
    starts.keep("rest", Point(np.full(problem.count, 3.0), {}), plain.structure, plain.start["rest"] + 1.0)
    own = np.array([plain.start["rest"]])
    assert (starts.near([("rest", Point(np.zeros(problem.count), {}))], plain.structure, own, {}) == own).all()


def test_runs_that_differ_in_other_conditions_only_are_one(problem):
    forward = fresh().forward
    z = np.zeros((2, problem.count))
    z[1, [n.conditions == ("hyperaemia",) for n in forward.nuisances]] = 0.5
    before = forward.simulation.runs
    forward.predict(z)
    assert forward.simulation.runs - before == 3, "rest once, hyperaemia twice"


def direct(one, other):
    """The distance of two points by its definition."""
    found = np.sum((one.z - other.z) ** 2)
    for key in one.sizes.keys() | other.sizes.keys():
        alike = key in one.sizes and key in other.sizes
        found += np.sum((one.sizes[key] - other.sizes[key]) ** 2) if alike else OTHER_EFFECT**2
    return np.sqrt(found)


def test_distances_are_those_to_the_latest_points():
    """Of more points than are remembered, with no, one or two effects of one or two sizes each."""
    random, known, latest = generator(8, "test", "starts"), KnownStates(3), {}
    counts = {("stenosis", "a"): 1, ("stenosis", "b"): 1, ("friction", "a"): 2}

    def drawn():
        keys = [key for key in counts if random.random() < 0.4]
        return Point(random.standard_normal(3), {key: random.standard_normal(counts[key]) for key in keys})

    for number in range(MOST + 50):
        latest[number % MOST] = drawn()
        known.add(latest[number % MOST], Structure(None, {}), np.zeros(1))
    for _ in range(20):
        point = drawn()
        expected = [direct(latest[seat], point) for seat in range(MOST)]
        assert known.distances(point) == pytest.approx(expected)
        assert point.distance == pytest.approx(direct(Point(np.zeros(3), {}), point))
