"""A campaign's runs are gathered in one folder; failures are reported, and too few runs stop the campaign."""

import numpy as np
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.estimation.runs.gather import CoarseCost, coarse_cost, gather, rows
from coronaryuq.estimation.runs.table import read_rows, read_runs
from support.case_files import case_summary
from support.small_campaign import AVERAGES, LIMITS, PAPERS, write_campaign


@pytest.fixture
def campaign(tmp_path):
    """Writes a campaign's files, gathers them, and returns the folder of runs."""

    def run(min_3d=4, **options):
        gather(write_campaign(tmp_path, **options), LIMITS, min_3d, tmp_path / "runs")
        return tmp_path / "runs"

    return run


def test_the_estimators_read_what_was_gathered(campaign):
    folder = campaign()
    runs = read_runs(folder)
    assert len(runs) == 12 and len(runs.theta_more) == 20 and runs.q_more is not None
    assert runs.limits.tolist() == [[0.5, 2.0], [0.5, 2.0], [0.7, 1.25]]
    chosen = read_rows(folder / "rows.csv")
    kinds = ("ffr_ffr", "ffr_flow", "osi_flow", "tawss_flow")
    assert [row.name for row in chosen] == [f"{kind}_{branch}" for kind in kinds for branch in ("lad", "rca")]
    for row in chosen:
        assert row.column_3d in runs.y and row.column_0d in runs.q


def test_averages_come_before_extremes_which_say_what_they_are(campaign):
    chosen = read_rows(campaign(quantities=(*PAPERS, *AVERAGES)) / "rows.csv")
    of_lad = [row for row in chosen if row.name.endswith("_lad")]
    columns = ["ffr", "ffr", "tawss_patch_min", "low_shear_area", "osi_patch_max", "osi_max", "tawss_min"]
    assert [row.column_3d for row in of_lad] == [f"{name}_lad" for name in columns]
    assert [row.networks for row in of_lad] == [True, True, False, False, False, True, True]
    assert [row.warning[:7] for row in of_lad] == [""] * 5 + ["extreme"] * 2


def test_pressures_have_rows_where_both_models_measured_them():
    """A solver of others may lack them; the lowest FFR is one of each artery, the drop one of each lesion."""
    stenoses = [{"name": "LAD"}, {"name": "LAD2", "artery": "LAD"}, {"name": "RCA"}]
    case = case_summary(stenoses=stenoses, outlets=[{}, {"name": "rca1", "branch": "RCA"}])
    columns = ["lowest_ffr_lad", "lowest_ffr_rca", *(f"pressure_drop_{name}" for name in ("lad", "lad2", "rca"))]
    found = rows(case, columns, [*columns, "mean_flow:lca1:BC_lca1"])
    new = found[~found["column_3d"].str.startswith(("ffr_", "osi_", "tawss_"))]
    assert list(new["column_3d"]) == columns == list(new["column_0d"])
    assert set(new["networks"]) == {"no"} == set(new["shared"]) and list(new["row"]) == columns
    assert new["qoi_3d"].iloc[0] == "lowest FFR" and list(new["branch"]) == ["LAD", "RCA", "LAD", "LAD2", "RCA"]
    assert set(found["shared"].drop(new.index)) == {"yes"}
    for one, other in ((columns, ["mean_flow:lca1:BC_lca1"]), (["ffr_lad"], columns)):
        assert not rows(case, one, other)["column_3d"].isin(columns).any()


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


def test_too_few_3d_runs_are_refused_with_the_most_frequent_reason(campaign):
    with pytest.raises(InputError, match="10 of 12.*at least 11 are needed; most frequent reason: blew up"):
        campaign(failed_3d=["pilot_00003", "pilot_00007"], min_3d=11)


def test_a_sample_without_a_3d_run_is_reported(campaign):
    with pytest.raises(InputError, match="pilot_00005.*has no 3D run"):
        campaign(lost=["pilot_00005"])


def test_a_coarse_level_covers_the_pilot_and_the_samples_beyond_it(campaign):
    folder = campaign(
        runs_per_fine=3,
        failed_3d=["pilot_00003"],
        failed_coarse=["pilot_00004", "pilot_00020"],
        failed_0d=["pilot_00030"],
    )
    runs = read_runs(folder)
    assert (
        len(runs) == 11 and len(runs.coarse.theta) == 23 == len(runs.coarse.q) and len(runs.coarse.outputs) == 11 + 23
    )
    failed = runs.coarse.outputs["ffr_lad"].isna().to_numpy().nonzero()[0].tolist()
    assert failed == [3, 11 + 8], "the pilot without its failed fine run, then sample 20, the ninth beyond it"
    inputs = np.concatenate([runs.theta, runs.coarse.theta])[:, 0]
    ended = runs.coarse.outputs["ffr_lad"].notna()
    np.testing.assert_array_equal(runs.coarse.outputs["ffr_lad"][ended], inputs[ended])
    failures = read_json(folder / "failures.json")
    assert failures["coarse"]["runs"] == 36 and len(failures["coarse"]["failed"]) == 2
    assert failures["cost"]["coarse_cpu_s"] == 72.0 and failures["cost"]["zerod_cpu_s"] == (36 + 20) * 0.5
    assert coarse_cost(folder / "failures.json") == CoarseCost(runs=36, failed=2, coarse_cpu_s=2.0, fine_cpu_s=2.0)


def test_tables_of_a_former_coarse_level_are_removed(campaign):
    campaign(runs_per_fine=3)
    folder = campaign()
    assert read_runs(folder).coarse is None and coarse_cost(folder / "failures.json") is None


def test_an_uncertain_parameter_of_any_sign_is_an_input_like_others(tmp_path):
    """Its bounds hold all samples; estimators see it as given, and multipliers by their logarithm."""
    files = write_campaign(tmp_path)
    values = np.linspace(-1.0, 2.0, 20)
    for path in (files.pilot, files.propagation):
        table = read_csv(path)
        write_csv(path, table.assign(shift=values[: len(table)]))
    gather(files, LIMITS, 4, tmp_path / "runs")
    runs = read_runs(tmp_path / "runs")
    assert runs.inputs == ("BC_lca1", "BC_rca1", "R_cor_scaling", "shift")
    assert runs.bounds("BC_lca1") == (0.5, 2.0) and runs.bounds("shift") == pytest.approx((-1.3, 2.3))
    assert runs.logged.tolist() == [True, True, True, False]
    assert np.array_equal(runs.coordinates(runs.theta_more)[:, 3], values)
