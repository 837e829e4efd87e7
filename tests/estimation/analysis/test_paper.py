"""The paper's correlation and standard deviations, to its printed digits."""

import pandas as pd

from coronaryuq.estimation.analysis.paper import paper_row
from coronaryuq.estimation.runs.table import pair, read_rows, read_runs


def test_original_correlation_and_both_standard_deviations_equal_the_printed_table(menon):
    runs, printed = read_runs(menon), pd.read_csv(menon / "table1.csv")
    for row, wanted in zip(read_rows(menon / "table1.csv"), printed.itertuples(), strict=True):
        got = paper_row(*pair(runs, row))
        assert round(got.rho_original, 4) == wanted.rho_original
        assert round(got.std_mc, 4) == wanted.std_mc
        assert round(got.std_mfmc, 4) == wanted.std_mfmc
