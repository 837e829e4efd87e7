"""The stage writes one row per sample, which does not depend on chunks or batches."""

import json

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MMHG
from coronaryuq.zerod.settings import Settings
from coronaryuq.zerod.stage import run_chunk
from support.case_files import write_case_json
from support.zerod_networks import closed_loop

LAD = {"vessel": "left", "ffr": "left:BC_left", "flow": "J0:left", "root": "J0:left", "outlet": "BC_left"}


@pytest.fixture
def inputs(tmp_path):
    random = np.random.default_rng(0)
    (tmp_path / "network.json").write_text(json.dumps(closed_loop(steps=1000)))
    outlets = [{"name": "left"}, {"name": "right", "perfuses": "RV"}]
    write_case_json(tmp_path / "case.json", outlets=outlets, stenoses=[LAD])
    columns = {name: random.uniform(0.5, 2.0, 7) for name in ("BC_left", "BC_right", "R_cor_scaling")}
    pd.DataFrame({"sample": [f"s{k}" for k in range(7)], **columns}).to_csv(tmp_path / "samples.csv", index=False)
    return tmp_path


def _chunk(folder, first, count, **settings) -> pd.DataFrame:
    paths = folder / "network.json", folder / "case.json", folder / "samples.csv"
    run_chunk(*paths, first, count, Settings(**settings), folder / "out.parquet")
    return pd.read_parquet(folder / "out.parquet")


def test_rows_do_not_depend_on_chunks_or_batches(inputs):
    whole = _chunk(inputs, 0, 7)
    parts = pd.concat([_chunk(inputs, 0, 3, batch=2), _chunk(inputs, 3, 4, batch=1)], ignore_index=True)
    pd.testing.assert_frame_equal(whole.drop(columns="cpu_s"), parts.drop(columns="cpu_s"), check_exact=True)
    assert list(whole["status"]) == ["ok"] * 7
    ratio = whole["mean_pressure:left:BC_left"] / whole["mean_pressure:J_heart_outlet:aorta"]
    assert np.array_equal(whole["ffr_lad"], ratio) and ratio.between(0.2, 1.0).all()


def test_the_drop_over_a_stenosis_follows_from_the_pressures_on_either_side(inputs):
    whole = _chunk(inputs, 0, 7)
    drop = (whole["mean_pressure:J0:left"] - whole["mean_pressure:left:BC_left"]) / MMHG
    assert np.array_equal(whole["pressure_drop_lad"], drop) and (drop > 0.1).all()


def test_the_lowest_ffr_of_an_artery_is_that_of_its_lowest_end_wherever_its_stenosis_is(inputs):
    """Both vessels are of one artery here; the pressure of an outlet of the RV counts, and gets no column."""
    left = _chunk(inputs, 0, 7)
    outlets = [{"name": "left", "perfuses": "RV"}, {"name": "right"}]
    right = LAD | {"vessel": "right", "ffr": "right:BC_right", "flow": "J0:right", "outlet": "BC_right"}
    write_case_json(inputs / "case.json", outlets=outlets, stenoses=[right])
    other = _chunk(inputs, 0, 7)
    assert (left["ffr_lad"] < other["ffr_lad"]).all() and "mean_pressure:left:BC_left" not in other
    for whole in (left, other):
        assert np.array_equal(whole["lowest_ffr_lad"], left["ffr_lad"])


@pytest.mark.slow
def test_a_failed_sample_has_a_row_without_values(inputs):
    rows = _chunk(inputs, 0, 2, periodic=True, cycles=60, tolerance=1e-15)
    assert list(rows["status"]) == ["failed", "failed"]
    assert rows["reason"].str.contains("not periodic").all() and rows["ffr_lad"].isna().all()


def test_a_bed_that_the_network_lacks_is_reported(inputs):
    table = pd.read_csv(inputs / "samples.csv").rename(columns={"BC_left": "BC_lost"})
    table.to_csv(inputs / "samples.csv", index=False)
    with pytest.raises(InputError, match="BC_lost"):
        _chunk(inputs, 0, 2)
