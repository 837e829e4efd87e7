"""A campaign's runs end in one folder; what failed is said, and too few runs stop it."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.core.records import Record, write
from coronaryuq.estimation.campaign.allocation import allocate
from coronaryuq.estimation.runs.gather import coarse_cost, gather
from coronaryuq.estimation.runs.table import read_rows, read_runs
from coronaryuq.estimation.settings import Settings

CASE = {"stenoses": [{"name": "LAD", "outlet": "BC_lca1"}, {"name": "RCA", "outlet": "BC_rca1"}]}
LIMITS = {"r": (0.5, 2.0), "R_cor_scaling": (0.7, 1.25)}


def theta(name, count):
    random = np.random.default_rng(len(name))
    columns = {bed: random.uniform(0.5, 2, count) for bed in ("BC_lca1", "BC_rca1")}
    samples = [f"{name}_{k:05d}" for k in range(count)]
    return pd.DataFrame({"sample": samples, **columns, "R_cor_scaling": random.uniform(0.7, 1.25, count)})


def zerod(table, failed=(), cpu_s=0.5):
    frame = pd.DataFrame({"sample": table["sample"], "status": "ok", "reason": "", "cpu_s": cpu_s})
    for column in ("mean_flow:lca1:BC_lca1", "mean_flow:rca1:BC_rca1", "ffr_lad", "ffr_rca"):
        frame[column] = 1 / table["R_cor_scaling"]
    frame.loc[frame["sample"].isin(failed), ["status", "reason"]] = "failed", "no convergence"
    return frame


def record(row, failed):
    inputs = {name: float(row[name]) for name in ("BC_lca1", "BC_rca1", "R_cor_scaling")}
    if row["sample"] in failed:
        return Record.failed(row["sample"], inputs, "blew up", cost={"cpu_s": 2.0})
    names = [f"{q}_{b}" for q in ("ffr", "osi_max", "tawss_min") for b in ("lad", "rca")]
    return Record(row["sample"], inputs, dict.fromkeys(names, inputs["BC_lca1"]), cost={"cpu_s": 2.0})


@pytest.fixture
def campaign(tmp_path):
    """Writes a campaign's files, with the named samples failed, and gathers them."""

    def run(failed_3d=(), failed_0d=(), min_3d=4, lost=(), per_fine=0, failed_coarse=()):
        table, propagation = theta("pilot", 12 * max(1, per_fine)), theta("propagation", 20)
        pilot = table.iloc[:12]
        write_json(tmp_path / "case.json", CASE)
        write_csv(tmp_path / "pilot.csv", table)
        write_csv(tmp_path / "propagation.csv", propagation)
        batches = []
        for k in range(3):
            rows = [row for _, row in pilot.iloc[4 * k : 4 * k + 4].iterrows() if row["sample"] not in lost]
            batches.append(tmp_path / f"batch_{k}.jsonl")
            write(batches[-1], [record(row, failed_3d) for row in rows])
        coarse = [tmp_path / "coarse_0.jsonl"] if per_fine else []
        for path in coarse:
            write(path, [record(row, failed_coarse) for _, row in table.iloc[::-1].iterrows()])
        zerod(table, failed_0d).to_parquet(tmp_path / "pilot_0.parquet")
        zerod(propagation, failed_0d).to_parquet(tmp_path / "propagation_0.parquet")
        gather(
            tmp_path / "case.json", tmp_path / "pilot.csv", tmp_path / "propagation.csv", batches,
            [tmp_path / "pilot_0.parquet"], [tmp_path / "propagation_0.parquet"], LIMITS, min_3d, tmp_path / "runs",
            coarse=coarse, runs_per_fine=per_fine,
        )  # fmt: skip
        return tmp_path / "runs"

    return run


def test_the_estimators_read_what_was_gathered(campaign):
    folder = campaign()
    runs = read_runs(folder)
    assert len(runs) == 12 and len(runs.theta_more) == 20 and runs.q_more is not None
    assert runs.limits.tolist() == [[0.5, 2.0], [0.5, 2.0], [0.7, 1.25]]
    rows = read_rows(folder / "rows.csv")
    assert [row.name for row in rows[:2]] == ["osi_flow_lad", "osi_flow_rca"] and len(rows) == 8
    for row in rows:
        assert row.column_3d in runs.y and row.column_0d in runs.q


def test_failed_3d_samples_keep_their_inputs(campaign):
    folder = campaign(failed_3d=["pilot_00003", "pilot_00007"])
    runs = read_runs(folder)
    assert len(runs) == 10 and len(runs.theta_failed) == 2
    failures = read_json(folder / "failures.json")
    assert [f["sample"] for f in failures["flow3d"]["failed"]] == ["pilot_00003", "pilot_00007"]
    assert failures["cost"]["flow3d_cpu_s"] == 24.0


def test_samples_without_a_0d_run_are_left_out(campaign):
    runs = read_runs(campaign(failed_0d=["pilot_00001", "propagation_00002"]))
    assert len(runs) == 11 and len(runs.theta_more) == 19


def test_too_few_3d_runs_stop_with_the_commonest_reason(campaign):
    with pytest.raises(InputError, match="10 of 12.*at least 11 are needed; most often: blew up"):
        campaign(failed_3d=["pilot_00003", "pilot_00007"], min_3d=11)


def test_a_lost_sample_is_named(campaign):
    with pytest.raises(InputError, match="pilot_00005.*has no 3D run"):
        campaign(lost=["pilot_00005"])


def test_a_coarse_level_stands_beside_the_pilot_and_goes_on_beyond_it(campaign):
    folder = campaign(
        per_fine=3, failed_3d=["pilot_00003"], failed_coarse=["pilot_00004", "pilot_00020"], failed_0d=["pilot_00030"]
    )
    runs = read_runs(folder)
    assert len(runs) == 11 and len(runs.theta_coarse) == 23 == len(runs.q_coarse) and len(runs.coarse) == 11 + 23
    failed = runs.coarse["ffr_lad"].isna().to_numpy().nonzero()[0].tolist()
    assert failed == [3, 11 + 8], "the pilot without its failed fine run, then sample 20, the ninth beyond it"
    inputs = np.concatenate([runs.theta, runs.theta_coarse])[:, 0]
    ended = runs.coarse["ffr_lad"].notna()
    np.testing.assert_array_equal(runs.coarse["ffr_lad"][ended], inputs[ended])
    failures = read_json(folder / "failures.json")
    assert failures["coarse"]["runs"] == 36 and len(failures["coarse"]["failed"]) == 2
    assert failures["cost"]["coarse_cpu_s"] == 72.0 and failures["cost"]["zerod_cpu_s"] == (36 + 20) * 0.5
    assert coarse_cost(folder / "failures.json") == {"runs": 36, "failed": 2, "coarse_cpu_s": 2.0, "fine_cpu_s": 2.0}


def test_tables_of_a_coarse_level_that_is_no_longer_there_go(campaign):
    campaign(per_fine=3)
    folder = campaign()
    assert read_runs(folder).coarse is None and coarse_cost(folder / "failures.json") is None


def test_a_growing_campaign_asks_for_the_same_runs_whatever_they_cost_this_time(tmp_path, campaign, capsys):
    """Half-widths are not met, so the plan decides; bytes of its file after runs of quite different CPU times."""
    campaign()
    paths = {
        "case_json": tmp_path / "case.json", "pilot_csv": tmp_path / "pilot.csv",
        "propagation_csv": tmp_path / "propagation.csv", "flow3d": [tmp_path / f"batch_{k}.jsonl" for k in range(3)],
        "zerod_pilot": [tmp_path / "pilot_0.parquet"], "zerod_propagation": [tmp_path / "propagation_0.parquet"],
    }  # fmt: skip
    settings = Settings(wanted={"ffr_flow_lad": 1e-3}, most_3d=48, most_0d=200, min_3d=4, cost_ratio=0.01)
    found = []
    for cpu_s in (0.5, 0.004):
        for name in ("pilot", "propagation"):
            table = read_csv(tmp_path / f"{name}.csv")
            zerod(table, cpu_s=cpu_s).to_parquet(tmp_path / f"{name}_0.parquet")
        counts, portion = {"n_3d": 12, "n_0d": 20}, {"n_3d": 4, "n_0d": 10}
        allocate(paths, LIMITS, settings, 1, 0, counts, portion, tmp_path / "round_0.json")
        found.append((tmp_path / "round_0.json").read_bytes())
    assert found[0] == found[1] and not read_json(tmp_path / "round_0.json")["done"]
    first, second = capsys.readouterr().out.strip().splitlines()
    assert first.endswith("measured so far: 0.25; declare cost_ratio: 0.2 for a cheaper plan")
    assert second.endswith("measured so far: 0.002; declare cost_ratio: 0.002 for a cheaper plan")
