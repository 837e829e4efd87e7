"""A pullback distinguishes a stenosis in one of several segments, a drift of the wire, and a diffuse loss."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.pullback_cases import VESSELS, Hidden, Wire, answers, truth_of, write_case
from coronaryuq.bench.discrepancy.trial import analyse
from coronaryuq.zerod.svzerodsolver.program import installed

pytestmark = pytest.mark.slow
DRIFT = "wire_drift at left_main>lad under hyperaemia"
SVZEROD = pytest.mark.skipif(installed() is None, reason="no svZeroDSolver")
PROGRAMS = [pytest.param("own", marks=pytest.mark.long), pytest.param("svzerod", marks=SVZEROD)]


CENTRES = [2.6, *(pytest.param(centre, marks=pytest.mark.long) for centre in (5.0, 8.2))]


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("centre", CENTRES)
def test_a_stenosis_is_named_in_its_segment(centre, program):
    hidden = Hidden(stenosis=centre)
    assert answers(hidden, Wire(), range(1, 2), program) == {f"focal_stenosis at {hidden.vessel}": 1}


def test_the_place_of_a_stenosis_is_found_within_its_segment():
    """To a millimetre or two: half a spacing of the readings beside the interval of the fit."""
    hidden, ends = Hidden(stenosis=5.0), np.cumsum([length for length, _ in VESSELS.values()])
    with TemporaryDirectory() as name:
        write_case(hidden, Wire(quantity="ratio"), 2, Path(name))
        found = analyse(Path(name))
    (placed,) = found.hypothesis
    (sizes,) = found.hypothesis.physical_sizes(found.fit.z)
    _, start, end = placed.effect.extent(placed.place, sizes, found.problem.forward.anatomy)
    assert ends[1] + 0.5 * (start + end) == pytest.approx(5.0, abs=0.2)


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_drift_alone_is_a_drift_and_no_stenosis(program):
    assert answers(Hidden(drift=8.0), Wire(), range(2, 4), program) == {DRIFT: 2}


@pytest.mark.long
def test_the_check_at_the_end_shows_a_smaller_drift():
    assert answers(Hidden(drift=5.0), Wire(checked=True), range(1, 4)) == {DRIFT: 3}


def test_a_diffuse_loss_is_named_as_one():
    assert answers(Hidden(narrowed="lad_seg1"), Wire(), range(1, 2)) == {"diffuse_narrowing at lad_seg1": 1}


@pytest.mark.long
@pytest.mark.parametrize("statistic", ["min", "max"])
def test_smallest_and_largest_pressures_show_a_stenosis_too(statistic):
    hidden = Hidden(stenosis=5.0)
    assert answers(hidden, Wire(statistic=statistic), range(2, 3)) == {"focal_stenosis at lad_seg1": 1}


@pytest.mark.parametrize("wire", [pytest.param(Wire(), marks=pytest.mark.long), Wire("ratio", checked=True)])
def test_where_nothing_is_hidden_nothing_is_named(wire):
    assert answers(Hidden(), wire, range(1, 4)) == {"nothing": 3}


def test_the_truth_has_the_length_of_the_model():
    lengths = {vessel["vessel_name"]: vessel["vessel_length"] for vessel in truth_of(Hidden(stenosis=5.0)).vessels}
    parts = sum(length for name, length in lengths.items() if name.startswith("lad_seg1"))
    assert parts == pytest.approx(VESSELS["lad_seg1"][0])


@pytest.mark.long
@pytest.mark.parametrize("program", PROGRAMS)
def test_sixty_pullbacks_with_nothing_hidden_raise_at_most_three_alarms(program):
    """At a true rate of 1 %, the level of the test, more than 3 of 60 have a probability of 0.003."""
    found = answers(Hidden(), Wire(), range(1, 61), program)
    assert found["nothing"] >= 57
