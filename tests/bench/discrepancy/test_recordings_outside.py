"""Effects outside the library that act on recorded waveforms, and those that are set aside."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.bench.discrepancy import set_aside
from coronaryuq.bench.discrepancy.cases import Case, set_aside_cases
from coronaryuq.bench.discrepancy.hidden_cases import OUTSIDE, OUTSIDE_LOOP, open_loop, outside
from coronaryuq.bench.discrepancy.recordings_outside import RECORDINGS, play
from coronaryuq.bench.discrepancy.trial import LEAST_VISIBLE, hide
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.hidden.nature import Nature
from coronaryuq.zerod.effects.names import EFFECTS

FILE = Path(__file__).parents[3] / "benchmarks" / "discrepancy-set-aside.json"
WAVES = st.lists(st.floats(-10.0, 10.0), min_size=4, max_size=30).map(np.array)


@given(WAVES, st.floats(0.0, 3.0))
def test_a_dead_band_lags_by_at_most_its_half_width(wave, half):
    read = play(wave, half)
    assert np.abs(read - wave).max() <= half + 1e-12
    assert play(wave, 0.0) == pytest.approx(wave)


def test_a_dead_band_reads_a_triangle_late_on_both_ways():
    """Rising it reads the value minus the half-width, falling the value plus it."""
    wave = np.concatenate([np.arange(0.0, 10.0), np.arange(10.0, 0.0, -1.0)])
    read = play(wave, 1.0)
    assert read[5] == 4.0 and read[15] == 6.0 and read.max() == 9.0


@given(WAVES, st.floats(0.1, 30.0))
def test_a_limited_slew_rate_is_kept_and_a_slow_waveform_read_itself(wave, step):
    read = set_aside.slewed(wave, step)
    # Sums of steps err by rounding.
    assert np.abs(np.diff(read)).max() <= step + 1e-9
    assert set_aside.slewed(wave, 2.0 * np.abs(wave).max() + 1.0) == pytest.approx(wave)


def test_a_limited_slew_rate_cuts_a_steep_rise_to_a_ramp():
    read = set_aside.slewed(np.r_[np.zeros(10), np.full(10, 8.0)], 2.0)
    assert read[10:15].tolist() == [2.0, 4.0, 6.0, 8.0, 8.0] and read[:5].tolist() == [6.0, 4.0, 2.0, 0.0, 0.0]


def test_names_outside_the_library_are_distinct():
    """At least ten, five of them set aside."""
    names = [*dict.fromkeys([*OUTSIDE, *OUTSIDE_LOOP]), *set_aside.EFFECTS]
    assert len(set(names)) == len(names) and len(set_aside.EFFECTS) == 5
    assert not set(names) & set(EFFECTS)


def test_the_file_of_the_effects_set_aside_names_each(tmp_path):
    cases = list(set_aside_cases(FILE))
    assert {case.outside for case in cases} == set(set_aside.EFFECTS)
    assert len({case.key for case in cases}) == len(cases) == 5 * json.loads(FILE.read_text())["seeds"]
    other = tmp_path / "other.json"
    other.write_text(json.dumps({"effects": ["spasm"], "first_seed": 1, "seeds": 1}))
    with pytest.raises(InputError, match="spasm.*no effect set aside; known: "):
        list(set_aside_cases(other))


@pytest.mark.slow
@pytest.mark.parametrize("name", [*RECORDINGS, *set_aside.EFFECTS])
def test_each_leaves_a_detectable_signal_in_the_open_loop(name, tmp_path):
    truth, _ = hide(Case((), "medium", "nominal", 7, name), open_loop(), tmp_path, Nature(vessels=0.08, beds=0.15))
    assert truth is not None and truth.visible >= LEAST_VISIBLE


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_recording_without_suitable_channels_has_no_place(name):
    assert RECORDINGS[name]([], np.random.default_rng(1)) is None
    assert outside(name, open_loop(), np.random.default_rng(1)) is not None
