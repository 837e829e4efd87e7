"""The noise that the data show about a model that is right."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from coronaryuq.bench.discrepancy.benchmark import NATURE
from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import hide, read_case
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.result.summary_text import paragraph
from coronaryuq.discrepancy.result.write import summary
from coronaryuq.discrepancy.selection.answer import NOTHING
from coronaryuq.discrepancy.selection.observed_noise import observe, uneven_noise
from coronaryuq.discrepancy.selection.search import discover


@pytest.mark.slow
def test_outliers_do_not_hide_that_a_model_is_right(tmp_path):
    """Noise is 1.43 times as large as stated, with a correlation of 0.5; ten samples lie 15 standard deviations off."""
    case = Case((), "none", "violated", 69000)
    hide(case, open_loop(), tmp_path, case.nature(NATURE))
    table = pd.read_csv(tmp_path / "measurements.csv")
    flows = np.flatnonzero((table.statistic == "waveform") & (table.quantity == "flow") & (table.condition == "rest"))
    spikes = flows[5::11][:10]
    table.loc[spikes, "value"] += 15.0 * table.sd[spikes]
    table.to_csv(tmp_path / "measurements.csv", index=False)
    problem = read_case(tmp_path)
    found = observe(problem, PLAIN, problem.calibrate(PLAIN))
    assert len(found.outliers) == len(spikes) and found.right
    for quantity in ("flow", "pressure"):
        assert found.estimates[quantity].scale == pytest.approx(1.43, rel=0.2)
        assert found.estimates[quantity].noise.correlation_time > 0.0


def louder(folder: Path, condition: str, times: float) -> None:
    """Add noise to all data of a condition, as if its standard deviations were understated."""
    table, random = pd.read_csv(folder / "measurements.csv"), np.random.default_rng(1)
    rows = np.flatnonzero(table.condition == condition)
    table.loc[rows, "value"] += np.sqrt(times**2 - 1.0) * table.sd[rows] * random.standard_normal(len(rows))
    table.to_csv(folder / "measurements.csv", index=False)


@pytest.mark.slow
def test_noise_that_one_condition_alone_has_is_known(tmp_path):
    """With one noise for all conditions "nothing is missing" had 0.75, with a p-value of 1e-15 beside it."""
    hide(Case((), "none", "nominal", 69001), open_loop(), tmp_path, NATURE)
    louder(tmp_path, "hyperaemia", 6.0)
    found = discover(read_case(tmp_path), 1)
    assert found.answer.given == NOTHING and found.answer.probabilities[NOTHING] > 0.8 and found.held_out_p > 0.01
    of = {f"{quantity} under hyperaemia" for quantity in ("flow", "pressure")}
    assert set(found.uneven) == of and all(4.0 < times < 9.0 for times in found.uneven.values())
    assert "pressure under hyperaemia as under other conditions" in paragraph(summary(found))


@pytest.mark.slow
def test_a_stenosis_is_found_beside_a_noisy_condition(tmp_path):
    truth, _ = hide(Case(("quadratic_stenosis",), "medium", "nominal", 69001), open_loop(), tmp_path, NATURE)
    louder(tmp_path, "pacing", 4.0)
    (entry,) = discover(read_case(tmp_path), 1).named
    assert truth.hypothesis.effects[0] in [member.placed for member in entry.members]


@pytest.mark.slow
def test_noise_that_is_the_same_under_all_conditions_is_not_uneven(tmp_path):
    hide(Case(("quadratic_stenosis",), "medium", "underestimated", 69002), open_loop(), tmp_path, NATURE)
    problem = read_case(tmp_path)
    assert uneven_noise(problem) == {}
