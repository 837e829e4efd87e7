"""The table on quantities that nobody has seen: constant, rare, scaled and half-named ones give numbers or one line."""

import json
import warnings

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.estimation.analysis.estimate_rows import estimate_row, prepare
from coronaryuq.estimation.analysis.paper_table import paper_table
from coronaryuq.estimation.estimators import per_row
from coronaryuq.estimation.estimators.design import make_design
from coronaryuq.estimation.runs.table import read_rows, read_runs
from coronaryuq.estimation.settings import Settings

SETTINGS = Settings(steps=(12, 8), restarts=1, curve_nodes=9, folds=2)
COLUMNS = {
    "constant": lambda y: 0 * y + 3.0,
    "zero": lambda y: 0 * y,
    "tiny": lambda y: 1e-12 * y,
    "huge": lambda y: 1e12 * y,
    "offset": lambda y: 1e6 + 1e-7 * y,
    "rare": lambda y: (np.arange(len(y)) == 3).astype(int),
    "ties": lambda y: y.round(1),
}


def table(folder, rows, settings=SETTINGS):
    pd.DataFrame(rows).to_csv(folder / "rows.csv", index=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return paper_table(folder, folder / "rows.csv", settings, 1, folder / "t.csv", folder / "t.md", folder)[0]


@pytest.mark.slow
def test_strange_quantities_give_finite_numbers(folder):
    outputs = pd.read_csv(folder / "outputs_3d.csv")
    made = {name: of(outputs["osi"]) for name, of in COLUMNS.items()}
    outputs.assign(**made).to_csv(folder / "outputs_3d.csv", index=False)
    (folder / "outputs_0d_propagation.csv").unlink()
    lines = table(folder, [{"row": name, "column_3d": name, "column_0d": "ffr_lad"} for name in COLUMNS])
    json.dumps(lines, allow_nan=False)
    assert [line["row"] for line in lines] == list(COLUMNS)
    still = next(line for line in lines if line["row"] == "constant")
    assert all(0 <= line["std_best_chain"] <= line["std_best"] for line in lines)
    assert still["mean_best"] == pytest.approx(3) and still["std_best"] == 0 and still["recommended"] == "MC"
    tiny, huge = (next(line for line in lines if line["row"] == name) for name in ("tiny", "huge"))
    assert tiny["std_best"] * 1e24 == pytest.approx(huge["std_best"], rel=1e-3)


def test_a_constant_0d_output_leaves_monte_carlo(folder):
    outputs = pd.read_csv(folder / "outputs_0d.csv")
    outputs.assign(still=1.0).to_csv(folder / "outputs_0d.csv", index=False)
    (folder / "outputs_0d_propagation.csv").unlink()
    (line,) = table(folder, [{"row": "a b.c", "column_3d": "osi", "column_0d": "still"}])
    assert line["rho_original"] == 0 and line["std_mfmc"] == line["std_mc"]


def test_what_the_paper_does_not_print_is_left_out(folder):
    plain = Settings(autoencoder=False, folds=2)
    rows = [{"row": 1, "column_3d": "osi", "column_0d": "ffr_lad", "rho_original": "n/a", "std_mc": 0.5}]
    (line,) = table(folder, rows, plain)
    assert "paper_rho_original" not in line and line["paper_std_mc"] == 0.5


@pytest.mark.parametrize("column", ["column_3d", "column_0d"])
def test_a_row_with_a_column_that_is_not_there_is_one_line(folder, column):
    row = {"row": 1, "column_3d": "osi", "column_0d": "ffr_lad"} | {column: "nope"}
    with pytest.raises(InputError, match="nope: column missing; the file has"):
        table(folder, [row])


@pytest.mark.long
def test_no_published_row_claims_less_than_the_batch_means_of_its_control_variate(menon):
    """The published propagation inputs are chains written in turn; row 11 has the largest error of a chain."""
    runs = read_runs(menon)
    (row,) = (row for row in read_rows(menon / "table1.csv") if row.name == "11")
    design = make_design(runs, [row], 5, 1, "R_cor_scaling", most=2)
    methods, findings = prepare(design, Settings(autoencoder=False), 1, beyond_mean=False)
    report = estimate_row(row, methods, findings)
    blocks = design.propagate(per_row.predict(design, row).raw)
    g = np.empty(len(runs.theta_more))
    for block, values in zip(design.blocks, blocks, strict=True):
        g[block.index] = values.values
    # Means of 500 successive samples. Their variance is known to a third from twenty.
    batches = g.reshape(20, -1).mean(axis=1)
    of_chain = batches.std(ddof=1) / 20**0.5
    assert of_chain > 3 * g.std() / len(g) ** 0.5, "or else this row shows nothing"
    best = report.estimators["crossfit-GP"]
    assert best.std > 0.67 * of_chain and best.variance["chain"] > 0.5 * best.std**2
    # Every estimator's error has that of the chain, and those that differ beyond it say so.
    assert report.recommended == "crossfit-GP" and not any("disagree" in warning for warning in report.warnings)
