"""The discrepancy figures are drawn from the tables alone, also where nothing was named."""

import numpy as np
import pandas as pd

from coronaryuq import files
from coronaryuq.figures import discrepancy as drawn
from coronaryuq.figures.discrepancy_benchmark import SHARES, benchmark


def is_png(path):
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_tree_shows_vessels_with_and_without_measurements(tmp_path):
    frame = {"vessel": ["a", "b", "c"], "parent": ["", "a", "a"], "mean_flow": 1.0, "disagreement": [5.0, np.nan, 1.0]}
    pd.DataFrame(frame).to_csv(tmp_path / "t.csv", index=False)
    drawn.tree(tmp_path / "t.csv", tmp_path / "t.png")
    assert is_png(tmp_path / "t.png")


def test_sizes_without_a_named_effect(tmp_path):
    columns = ["effect", "place", "parameter", "unit", "size", "posterior", "prior"]
    pd.DataFrame([], columns=columns).to_csv(tmp_path / "s.csv", index=False)
    drawn.sizes(tmp_path / "s.csv", tmp_path / "s.png")
    assert is_png(tmp_path / "s.png")


def test_gap_and_ranking(tmp_path):
    models = ["recalibration alone", "with the named effects", "flexible discrepancy"]
    gap = {"model": models, "misfit": [3.0, 1.0, 2.0], "low": [2.5, 0.9, 1.5], "high": [3.5, 1.1, 2.5]}
    pd.DataFrame(gap).assign(log_predictive_density=0.0, noise_floor=1.0).to_csv(tmp_path / "g.csv", index=False)
    drawn.gap(tmp_path / "g.csv", tmp_path / "g.png")
    names = {"round": 1, "effect": ["none", "leak"], "place": ["", "lad"], "probability": [0.1, 0.9], "score": 0.0}
    pd.DataFrame(names).assign(accepted=[False, True]).to_csv(tmp_path / "r.csv", index=False)
    drawn.ranking(tmp_path / "r.csv", tmp_path / "r.png")
    assert is_png(tmp_path / "g.png") and is_png(tmp_path / "r.png")


def test_benchmark_draws_what_was_hidden_against_what_was_named(tmp_path):
    share = {"share": 0.9, "low": 0.7, "high": 0.98, "trials": 20}
    confusion = {"none": {"none": 5}, "leak": {"leak": 3, "none": 1}, "outside:x": {"outside": 2, "stenosis": 1}}
    totals = dict.fromkeys(SHARES, share) | {"both_of_two": {"share": None, "low": None, "high": None, "trials": 0}}
    files.write_json(tmp_path / "b.json", {"totals": totals, "confusion": confusion})
    benchmark(tmp_path / "b.json", tmp_path / "b.png")
    assert is_png(tmp_path / "b.png")
