"""Tables in the documents agree with the recorded cells of the coverage benchmark."""

import numpy as np
import pytest

from coronaryuq.bench.estimation.coverage import judged
from coronaryuq.core.seeds import generator
from support.benchmark_scripts import benchmark_script


@pytest.fixture(scope="module")
def script():
    return benchmark_script("estimation_coverage")


def cell(first, trials, method="crossfit-GP", problem="row 9", n_3d=250):
    """Cells of one long list of trials."""
    rng = generator(1, "page")
    errors, stds = rng.normal(0.1, 1, 400)[first : first + trials], rng.uniform(0.8, 1.2, 400)[first : first + trials]
    named = {"problem": problem, "method": method, "n_3d": n_3d, "first_trial": first}
    return named | judged(errors, stds, np.abs(errors) < 2 * stds)


def test_the_page_holds_the_tables_of_the_cells(script):
    page, cells = script.PAGE.read_text(encoding="utf-8"), script.read(script.CELLS)
    for method in script.METHODS:
        assert script.put(page, f"coverage of {method}", script.table(cells, method)) == page, method
    for method in script.SUMMARISED:
        assert script.put(page, f"summary of {method}", script.summary(cells, method)) == page, method


def test_trials_that_follow_a_cells_own_are_pooled_with_it(script):
    (got,) = script.merged([cell(0, 100)], [cell(100, 300)])
    assert got == pytest.approx(cell(0, 400))
    assert script.merged([got], [cell(0, 100), cell(100, 300)]) == [got], "put in once more, they change nothing"


def test_a_former_selectors_cell_is_replaced_where_the_present_one_is_measured(script):
    former = [
        cell(0, 400, "crossfit-GP, without extrapolation factor"),
        cell(0, 400, "crossfit-GP, without extrapolation factor", problem="row 8"),
    ]
    assert [c["method"] for c in script.merged(former, [cell(0, 100)])] == [
        "crossfit-GP, without extrapolation factor",
        "crossfit-GP",
    ]
    assert script.merged([cell(0, 100)], former[:1]) == [cell(0, 100)]
