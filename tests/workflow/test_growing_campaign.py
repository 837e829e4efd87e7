"""A campaign with a target interval, every stage real: bitwise identical results from two copies, and its report."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.records import read as read_records
from coronaryuq.posterior.results import Chains
from support import smoke
from support.checkout import ROOT, Checkout

pytestmark = [pytest.mark.workflow, pytest.mark.long]

ROW, TARGET = "ffr_flow_lad", 0.013
"""From 24 runs this takes a second round; a tenth of it takes more than MOST allows."""
MOST = {"max_3d": 48, "max_0d": 300}


def grow(checkout: Checkout, half_width: float, cores: int, **changed: dict) -> Path:
    settings = yaml.safe_load((ROOT / "config" / "smoke.yaml").read_text())
    for block, changes in yaml.safe_load(smoke.SMALLER).items():
        settings[block] = settings.get(block, {}) | changes
    settings["samples"] |= {"n_3d": 24, "n_0d": 200}
    settings["estimation"] |= MOST | {"target_half_width": {ROW: half_width}}
    for block, changes in changed.items():
        settings[block] |= changes
    done = checkout.run("--nolock", "--cores", str(cores), settings=settings)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return checkout.folder / "results" / "smoke"


def rounds(results: Path) -> list[dict]:
    return [read_json(path) for path in sorted((results / "allocation").glob("round_*.json"))]


def target_lines(results: Path) -> list[str]:
    """Return the lines of the report on target widths."""
    (listed,) = re.findall(
        "Target interval widths</b></p><ul>(.*?)</ul>", (results / "report.html").read_text(), re.DOTALL
    )
    return re.findall(r"<li[^>]*>(.*?)</li>", listed, re.DOTALL)


def half_width(results: Path) -> float:
    """Of the recommended estimator, from the table that a reader gets."""
    (row,) = [row for row in read_json(results / "estimation" / "estimates.json")["rows"] if row["row"] == ROW]
    table = read_csv(results / "estimation" / "table.csv").set_index(["row", "estimator"])
    line = table.loc[(ROW, row["recommended"])]
    return (line["calibrated_high"] - line["calibrated_low"]) / 2


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    checkout = Checkout(tmp_path_factory.mktemp("grows") / "one")
    return checkout, grow(checkout, TARGET, cores=2)


def test_it_grows_until_the_target_width_is_met_and_reports_it(first):
    _, results = first
    decided = rounds(results)
    assert len(decided) >= 2 and [one["done"] for one in decided] == [False] * (len(decided) - 1) + [True]
    assert decided[0]["plan"][0]["half_width"] > TARGET and decided[-1]["why"] == "met"
    for before, after in zip(decided, decided[1:], strict=False):
        assert after["counts"] == before["next"]
    ran = sum(len(read_records(path)) for path in (results / "flow3d").glob("batch_*.jsonl"))
    assert ran == decided[-1]["counts"]["n_3d"] == len(read_csv(results / "runs" / "params.csv"))
    assert half_width(results) <= TARGET
    row, end = target_lines(results)
    assert (
        f"± {TARGET} targeted" in row
        and "this needs" not in row
        and "Half the target width, ± 0.0065, would cost" in row
    )
    assert "all target widths were reached" in end


def test_another_copy_on_one_core_gives_bitwise_identical_results(first, tmp_path):
    _, results = first
    again = grow(Checkout(tmp_path / "another" / "folder"), TARGET, cores=1)
    assert not smoke.differing(results, again) and not smoke.differing(again, results)
    assert [one["plan"] for one in rounds(results)] == [one["plan"] for one in rounds(again)]


def test_at_the_bounds_it_stops_and_reports_the_missing_runs(first):
    checkout, _ = first
    results = grow(checkout, TARGET / 10, cores=2)
    decided = rounds(results)
    assert decided[-1]["why"] == "bounds reached" and decided[-1]["counts"]["n_3d"] == MOST["max_3d"]
    assert half_width(results) > TARGET / 10
    row, end = target_lines(results)
    assert re.search(r"this needs about [\d,]+ 3D runs", row) and "the maximum number of runs" in end


CHAIN_TARGET = 0.004
"""From chains of 15 draws after burn-in this takes longer ones, and no more 3D runs."""


def test_chains_that_limit_the_error_are_made_longer_until_the_target_width_is_met(tmp_path):
    short_chains = {"posterior": {"independence": {"draws": 20}}, "estimation": {"max_0d": 3200}}
    results = grow(Checkout(tmp_path / "chains"), CHAIN_TARGET, 2, **short_chains)
    decided = rounds(results)
    (plan,) = decided[0]["plan"]
    assert plan["longer_chain"] > 1 and plan["more_3d"] == plan["more_0d"] == 0 and plan["half_width"] > CHAIN_TARGET
    assert decided[0]["next"] == {"n_3d": 24, "n_0d": 400, "lengths": [[0, 1], [200, 2]]}
    assert decided[-1]["why"] == "met" and half_width(results) <= CHAIN_TARGET
    assert len(read_csv(results / "runs" / "params.csv")) == decided[-1]["counts"]["n_3d"] == 24
    short, long = (Chains.read(results / "posterior" / f"length_{length}" / "chains.npz") for length in (1, 2))
    assert (
        np.array_equal(short.kept_multipliers, long.kept_multipliers[:, :15]) and long.kept_multipliers.shape[1] == 30
    )
    assert long.runs - short.runs == 15 * len(short.multipliers)
    drawn = read_csv(results / "samples" / "propagation.csv")["draw"]
    assert drawn[:200].max() <= short.generations < drawn[200:400].min()
    _, end = target_lines(results)
    assert "24 3D and 400 propagation runs, chains 2 times as long as the first ones: all target widths" in end
