"""What Snakemake would run and what a change makes stale: the real workflow, without running its jobs."""

import copy
import importlib.metadata
import sys

import pytest

from support.case_files import add_measurements
from support.checkout import Checkout

pytestmark = pytest.mark.workflow

ENDS = {"figure", "report", "all"}
ESTIMATES = {"runs", "estimation_train", "zerod_resampled", "estimation", "pairs", "budget"} | ENDS


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A campaign that has run, as far as Snakemake can tell."""
    checkout = Checkout(tmp_path_factory.mktemp("finished"))
    checkout.pretend_done()
    return checkout


@pytest.fixture
def after_edits(finished):
    """Jobs of that campaign after edits, line per module, which end with the test."""
    edited = {}

    def jobs(edits):
        edited.update(edits)
        for module, line in edits.items():
            finished.edit(module, line)
        return finished.dry_run()

    yield jobs
    finished.restore(*edited)


def changed(checkout, **blocks):
    settings = copy.deepcopy(checkout.settings)
    for block, values in blocks.items():
        if isinstance(values, dict):
            settings.setdefault(block, {}).update(values)
        else:
            settings[block] = values
    return settings


def test_a_campaign_goes_through_every_stage(checkout):
    jobs = checkout.dry_run()
    assert jobs["flow3d_batch"] == 2 and jobs["zerod_chunk"] == 1 + 2
    assert {"bundled_patient", "case", "mesh", "perfusion", "calibration", "posterior"} | ESTIMATES <= set(jobs)


def test_nothing_runs_twice(finished):
    assert finished.dry_run() == {}


def test_more_samples_leave_the_old_ones_alone(finished):
    jobs = finished.dry_run(settings=changed(finished, samples={"n_3d": 24, "n_0d": 96}))
    assert jobs["flow3d_batch"] == 1, "one batch of eight more"
    assert jobs["zerod_chunk"] == 1 + 1, "the pilot's only chunk has grown, the propagation sample has one more"
    assert set(jobs) == {"flow3d_batch", "zerod_chunk", "samples"} | ESTIMATES


TUNED_AGAIN = {"calibration", "posterior_chains", "posterior_draws", "posterior", "pressure_map", "samples"}
RUN_AGAIN = {"flow3d_batch", "zerod_chunk"}
ADOPTION = {
    *("adoption_calibration", "adopt", "adopted_in_3d", "adoption_chains", "adoption_draws"),
    *("adoption_prediction", "adoption_comparison"),
}
SEARCH = {"discrepancy_hidden", "discrepancy_search", "discrepancy_known", "discrepancy_figure"}


def test_adoption_tunes_again_and_runs_all_that_follows_and_nothing_that_came_before(finished):
    """Patient, case, perfusion and mesh are kept; the search reads a loop that is tuned before it."""
    jobs = finished.dry_run(settings=changed(finished, discrepancy={"adopt": True}))
    assert set(jobs) == TUNED_AGAIN | RUN_AGAIN | ADOPTION | SEARCH | ESTIMATES
    assert jobs["adoption_prediction"] == 2 and jobs["calibration"] == jobs["adoption_calibration"] == 1
    assert jobs["flow3d_batch"] == 2, "the loop beside the mesh has the effects"


def test_adoption_switched_off_again_leaves_its_files_and_runs_the_campaign_as_before(checkout):
    on = changed(checkout, discrepancy={"adopt": True})
    with_it, without = (checkout.dry_run(settings=settings) for settings in (on, checkout.settings))
    assert set(with_it) - set(without) == ADOPTION | SEARCH and not set(without) - set(with_it)


@pytest.mark.long
def test_calibration_and_posterior_are_fitted_to_the_flows_without_the_errors_of_the_map(checkout):
    checkout.settings = changed(checkout, discrepancy={"adopt": True})
    checkout.pretend_done()
    (target,) = checkout.folder.glob("results/*/adopted/targets.json")
    target.write_text(target.read_text() + " ")
    jobs = set(checkout.dry_run())
    assert jobs >= {"calibration", "posterior_chains", "report"}
    assert not jobs & {"adopt", "adoption_calibration", "adoption_chains", "discrepancy_search"}


def test_the_target_adopted_makes_no_3d_run(checkout):
    jobs = checkout.dry_run("adopted", settings=changed(checkout, discrepancy={"adopt": True}))
    assert set(jobs) >= ADOPTION and not {"flow3d_batch", "runs", "report"} & set(jobs)
    refused = checkout.run("adopted", "--dry-run")
    assert refused.returncode and "discrepancy.adopt = False: nothing is adopted; set true" in refused.stderr


def test_a_coarse_level_adds_a_mesh_batches_and_0d_runs_and_leaves_the_rest_alone(finished):
    """Four coarse runs for each of sixteen fine ones: eight batches, and 0D runs at the additional inputs."""
    jobs = finished.dry_run(settings=changed(finished, flow3d={"coarse": {"runs_per_fine": 4}}))
    assert jobs["flow3d_batch"] == 8 and jobs["mesh"] == jobs["mesh_folder"] == 1
    assert jobs["zerod_chunk"] == 2, "the pilot's chunk of 16 has grown to 32, one more has 32"
    assert set(jobs) == {"flow3d_batch", "mesh", "mesh_folder", "zerod_chunk", "samples"} | ESTIMATES


@pytest.mark.parametrize(
    ("n_3d", "again"),
    [
        (16, {"mesh": 1, "mesh_folder": 1, "flow3d_batch": 1}),
        (104, {"mesh": 2, "mesh_folder": 2, "flow3d_batch": 3}),
    ],
)
def test_a_campaign_measures_its_mesh_error_unless_that_is_switched_off(checkout, n_3d, again):
    off = changed(checkout, samples={"n_3d": n_3d})
    on = {block: values for block, values in off.items() if block != "flow3d"}
    with_study, without = (checkout.dry_run(settings=settings) for settings in (on, off))
    assert with_study - without == again | {"mesh_study": 1}, "as many levels as a quarter of the 3D runs pays for"
    assert without - with_study == {} and "mesh_study" not in without


def test_the_target_mesh_study_runs_all_levels_where_the_campaign_runs_none(checkout):
    jobs = checkout.dry_run("mesh_study")
    assert jobs["mesh"] == 3 and jobs["flow3d_batch"] == 1 + 3 and jobs["mesh_study"] == 1


def test_a_new_seed_keeps_the_patient_and_the_mesh(finished):
    jobs = set(finished.dry_run(settings=changed(finished, seed=7)))
    assert {"perfusion_chunk", "calibration", "posterior_chains", "flow3d_batch", "zerod_chunk"} <= jobs
    assert not {"bundled_patient", "case", "mesh"} & jobs


@pytest.mark.parametrize(
    ("block", "values", "stale", "fresh"),
    [
        (
            "perfusion",
            {"correlation_length": 2.0},
            {"perfusion_chunk", "calibration", "flow3d_batch"},
            {"case", "mesh"},
        ),
        ("flow3d", {"max_cycles": 3}, {"flow3d_batch"} | ESTIMATES, {"zerod_chunk", "posterior", "mesh"}),
        ("estimation", {"folds": 3}, ESTIMATES, {"flow3d_batch", "zerod_chunk", "posterior"}),
    ],
)
def test_a_changed_setting_makes_stale_what_depends_on_it(finished, block, values, stale, fresh):
    jobs = set(finished.dry_run(settings=changed(finished, **{block: values})))
    assert stale <= jobs
    assert not fresh & jobs


@pytest.mark.parametrize(
    ("module", "stale", "fresh"),
    [
        (
            "posterior/sampler/dream.py",
            {"posterior_chains", "flow3d_batch"},
            {"perfusion_chunk", "calibration", "mesh"},
        ),
        pytest.param(
            "flow3d/fem/wall_shear.py",
            {"flow3d_batch"} | ESTIMATES,
            {"zerod_chunk", "posterior"},
            marks=pytest.mark.long,
        ),
        pytest.param(
            "estimation/analysis/budget.py",
            {"budget"},
            {"estimation_train", "zerod_resampled"},
            marks=pytest.mark.long,
        ),
        pytest.param(
            "estimation/analysis/tables.py",
            {"estimation"},
            {"estimation_train", "zerod_resampled"},
            marks=pytest.mark.long,
        ),
        pytest.param("report/page.py", {"report"}, {"figure", "estimation"}, marks=pytest.mark.long),
        pytest.param("report/style.css", {"report"}, {"figure", "estimation"}, marks=pytest.mark.long),
        ("figures/style.py", {"figure"}, {"estimation", "flow3d_batch"}),
    ],
)
def test_an_edit_of_an_imported_module_makes_stale_what_imports_it(after_edits, module, stale, fresh):
    jobs = set(after_edits({module: "a {}" if module.endswith("css") else "EDITED = True"}))
    assert stale <= jobs
    assert not fresh & jobs


def test_comments_and_docstrings_make_nothing_stale(after_edits):
    assert after_edits({"posterior/sampler/dream.py": "# A comment.", "zerod/stage.py": '"""A docstring."""'}) == {}


def test_figures_alone_compute_nothing_else(finished):
    for figure in (finished.folder / "results" / "tiny" / "figures").iterdir():
        figure.unlink()
    try:
        assert set(finished.dry_run("figures")) == {"figure", "figures"}
    finally:
        finished.run("figures", "--touch", "--force")


@pytest.mark.parametrize(
    ("settings", "error"),
    [
        ({"name": "../up"}, "name = '../up'"),
        ({"name": "x", "seed": -1}, "seed = -1"),
        ({"name": "x", "sampels": {}}, "sampels = {}: unknown setting; did you mean samples? known here: name, seed"),
        ({"name": "x", "samples": {"n_3d": "many"}}, "samples.n_3d = 'many'"),
        ({"name": "x", "backend": "fluent"}, "backend = 'fluent'"),
        ({"name": "x", "case": "nowhere/case.yaml"}, "nowhere/case.yaml: no such file"),
    ],
)
def test_a_wrong_configuration_is_one_line_and_nothing_is_written(checkout, settings, error):
    done = checkout.run("--dry-run", settings=settings)
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    assert done.returncode == 2
    assert len(lines) == 1 and error in lines[0], done.stderr
    assert not (checkout.folder / "results").exists()


def test_a_search_on_pairs_needs_nothing_of_the_campaign(checkout):
    for name in ("simulated.csv", "measured.csv"):
        (checkout.folder / name).write_text("sample\n")
    settings = changed(checkout, discrepancy={"pairs": ["simulated.csv", "measured.csv"]})
    jobs = checkout.dry_run("discrepancy", settings=settings)
    assert set(jobs) == {"discrepancy_pairs", "discrepancy_figure", "discrepancy_report", "discrepancy"}


@pytest.mark.long
def test_an_edit_of_the_summary_text_leaves_searches_fresh(checkout):
    checkout.pretend_done("discrepancy")
    checkout.edit("discrepancy/result/summary_text.py")
    assert set(checkout.dry_run("discrepancy")) == {"discrepancy_text", "discrepancy_report", "discrepancy"}


def test_a_search_in_the_report_is_part_of_the_campaign(checkout):
    settings = changed(checkout, discrepancy={"in_report": True})
    assert {"discrepancy_hidden", "discrepancy_search", "report"} <= set(checkout.dry_run(settings=settings))
    assert "discrepancy_search" not in checkout.dry_run()


@pytest.mark.long
def test_losses_are_learnt_before_the_posterior_of_all_others(checkout):
    settings = changed(checkout, losses={"runs_3d": 8})
    jobs = checkout.dry_run(settings=settings)
    assert {"losses_calibration", "losses_inputs", "losses_runs", "losses", "losses_in_3d"} <= set(jobs)
    assert jobs["calibration"] == 1 and not [job for job in checkout.dry_run() if job.startswith("losses")]
    checkout.settings = settings
    checkout.pretend_done()
    checkout.edit("losses/fit.py")
    again = set(checkout.dry_run())
    assert {"losses", "calibration", "posterior_chains", "flow3d_batch", "zerod_chunk"} <= again
    assert not {"losses_calibration", "losses_inputs", "losses_runs", "mesh", "perfusion"} & again


def test_a_case_without_3d_learns_no_losses(checkout):
    path = checkout.folder / checkout.small_case()
    path.write_text(path.read_text().replace("[{name: LAD, vessel: lca1, start: 1.0, end: 2.0}]", "[]"))
    settings = changed(checkout, case="given/case.yaml", losses={"runs_3d": 8})
    assert not [job for job in checkout.dry_run("posterior", settings=settings) if job.startswith("losses")]


def test_a_patient_without_measurements_gets_no_invented_effect(checkout):
    case = checkout.small_case()
    settings = changed(checkout, case=case, discrepancy={"in_report": True})
    jobs = checkout.dry_run(settings=settings)
    assert "report" in jobs and not [job for job in jobs if job.startswith("discrepancy")]
    done = checkout.run("discrepancy", settings=settings)
    assert done.returncode == 2 and "discrepancy.measurements: nothing to search" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_measurements_of_a_case_are_searched_by_its_campaign(checkout):
    settings = changed(checkout, case=checkout.small_case())
    add_measurements(checkout.folder / "given" / "case.yaml")
    jobs = checkout.dry_run(settings=settings)
    assert jobs["discrepancy_search"] == 1 and "discrepancy_hidden" not in jobs
    assert "discrepancy_search" not in checkout.dry_run(settings=settings | {"discrepancy": {"in_report": False}})
    checkout.settings = settings
    checkout.pretend_done()
    with (checkout.folder / "given" / "measured.csv").open("a") as table:
        table.write("rest,pressure,lca2:BC_lca2,mean,,87,1.5,mmHg\n")
    again = set(checkout.dry_run())
    assert again == {"discrepancy_search", "discrepancy_figure", "report", "all"}, "nothing else depends on them"


def test_a_benchmark_has_a_job_per_network_and_seed_and_more_seeds_are_only_more(checkout):
    (checkout.folder / "mine.json").write_text("{}")
    wanted = {"networks": ["open_loop", "mine.json"], "seeds": 3, "first_seed": 7}
    jobs = checkout.dry_run("discrepancy_benchmark", settings=changed(checkout, discrepancy={"benchmark": wanted}))
    rest = ("tables", "figure", "")
    rest = {f"discrepancy_benchmark_{name}".rstrip("_"): 1 for name in rest}
    assert jobs == {"discrepancy_benchmark_seed": 6} | rest, "nothing of the campaign"
    wanted["networks"] = ["campaign"]
    jobs = checkout.dry_run("discrepancy_benchmark", settings=changed(checkout, discrepancy={"benchmark": wanted}))
    assert jobs["discrepancy_benchmark_seed"] == 3 and jobs["calibration"] == 1


def test_a_missing_network_of_the_benchmark_is_one_line(checkout):
    settings = changed(checkout, discrepancy={"benchmark": {"networks": ["gone.json"]}})
    done = checkout.run("discrepancy_benchmark", settings=settings)
    assert done.returncode == 2 and "discrepancy.benchmark.networks = 'gone.json': no such file" in done.stderr


def test_a_missing_table_is_one_line(checkout):
    done = checkout.run("discrepancy", settings=changed(checkout, discrepancy={"pairs": ["gone.csv", "lost.csv"]}))
    assert done.returncode == 2
    assert "gone.csv" in done.stderr and "no such file" in done.stderr and "Traceback" not in done.stderr


def test_missing_files_of_a_search_are_one_line_before_any_job(checkout):
    for name in ("model.json", "measured.csv", "X_baseline.csv", "X_mild_sten.csv"):
        (checkout.folder / name).write_text("")
    (checkout.folder / "conditions.yaml").write_text("rest: {drive: {AORTA: gone.csv}}\n")
    case = {"model": "model.json", "measurements": "measured.csv", "conditions": "conditions.yaml"}
    animal = {"recordings": ".", "animals": ["X"], "held_out": ["severe"]}
    for settings, error in (
        (case, "discrepancy.conditions = 'gone.csv': no such file"),
        (animal, "discrepancy.held_out = 'severe': not recorded; recorded are baseline, mild_sten"),
    ):
        done = checkout.run("discrepancy", settings=changed(checkout, discrepancy=settings))
        assert done.returncode == 2 and error in done.stderr and "Traceback" not in done.stderr


def test_no_script_hides_a_library(checkout):
    """Snakemake puts the scripts' folder first on the path: a script named like a library would be imported instead."""
    taken = {*sys.stdlib_module_names, *importlib.metadata.packages_distributions()}
    taken |= {"coverage"}  # numba imports it where it is there
    scripts = {path.stem for path in (checkout.folder / "workflow" / "scripts").glob("*.py")}
    assert not scripts & taken
