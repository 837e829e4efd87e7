"""The stage from files to files: the same bits however it is run, sound outputs, clear errors."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray

from coronaryuq.case.case_json import read_case
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.io.tables import read_csv
from coronaryuq.posterior import stage
from coronaryuq.posterior.model.bed_flows import BedFlows
from coronaryuq.posterior.results import Chains, ReferenceShares, read_summary
from coronaryuq.posterior.sampler.checkpoint import RECORDED, Recorder
from coronaryuq.posterior.settings import DreamSettings, EmulatorSettings, IndependenceSettings, Settings
from coronaryuq.posterior.summary import summarise, table_of_draws
from support.resistor_tree import ResistorTree, network_of, targets_of

FILES = ("posterior.nc", "draws.csv", "summary.json", "fractions.csv", "fitted.json")
SMALL = Settings(
    dream=DreamSettings(chains=24, generations=160), emulator=EmulatorSettings(generations=4), checkpoint=40,
    independence=IndependenceSettings(draws=40),
)  # fmt: skip
DELAYED = SMALL.model_copy(update={"independence": IndependenceSettings(use=False)})


def outputs(folder):
    return stage.GatheredFiles(*(folder / name for name in FILES))


def sampled(campaign, folder, settings=SMALL, seed=3, length=1, before=None):
    stage.sample(*campaign, settings, seed, folder / "chains.npz", extent=stage.Extent(length, before))
    return folder / "chains.npz"


def arrays(path):
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


def same(a, b, without=()):
    a, b = arrays(a), arrays(b)
    assert a.keys() == b.keys()
    for name in a.keys() - set(without):
        assert np.array_equal(a[name], b[name], equal_nan=a[name].dtype.kind == "f"), name


def command(campaign, out, ranks=None, settings=SMALL, more=()):
    launcher = [] if ranks is None else [str(Path(sys.executable).with_name("mpiexec")), "-n", str(ranks)]
    run = [sys.executable, "-m", "coronaryuq.posterior", *map(str, campaign), str(out)]
    more = (*more, *["--mpi"] * (ranks is not None))
    return [*launcher, *run, "--seed", "3", "--settings", settings.model_dump_json(), *more]


def test_engine_flows_are_those_of_the_resistors(campaign, tree):
    outlets = {o.bc: o.vessel for o in read_case(campaign[0]).outlets}
    model = BedFlows(campaign[1], outlets, tolerance=1e-6, steps_per_cycle=None)
    m = np.random.default_rng(0).uniform(0.5, 2, size=(9, 6))
    assert np.allclose(model.weights, tree.weights)
    assert np.allclose(model.flows(m), tree.flows(m), rtol=1e-6)


@pytest.mark.slow
def test_from_files_to_files(campaign, tmp_path):
    settings = SMALL.model_copy(deep=True)
    settings.dream.generations, settings.independence.draws = 2000, 120
    chains = sampled(campaign, tmp_path, settings)
    out = outputs(tmp_path)
    stage.gather(*campaign, chains, settings, 3, out)
    (tmp_path / "again").mkdir()
    stage.gather(*campaign, chains, settings, 3, outputs(tmp_path / "again"))
    assert all((tmp_path / "again" / name).read_bytes() == (tmp_path / name).read_bytes() for name in FILES)
    summary, draws = read_summary(out.summary), read_csv(out.draws)
    data = xarray.open_datatree(out.posterior, engine="h5netcdf")
    assert data["posterior"]["r"].shape == (24, 115, 6)
    assert list(data["posterior"]["bed"].values) == [f"BC_{i}" for i in range(6)]
    weights = arrays(chains)["weights"]
    assert np.allclose((weights / draws[[f"BC_{i}" for i in range(6)]]).sum(axis=1), 1)
    assert summary.emulator.acceptance is not None and summary.acceptance > 0.9
    steps = summary.independence
    assert steps.used and steps.warning is None
    assert summary.model_runs == arrays(chains)["runs"] < 24 * 135
    assert summary.effective_per_run == summary.ess_bulk_min / summary.model_runs > 0.7
    assert min(summary.ess_tail.values()) > 0.5 * summary.model_runs
    assert summary.rhat_max < 1.1 and summary.worst_parameter in summary.rhat
    assert summary.verdict.startswith("converged" if summary.converged else "not converged")
    predictive = summary.predictive
    assert predictive.coverage_95 == 1.0
    assert predictive.mahalanobis < 2 and 0.05 < predictive.p_value < 0.95
    assert np.all(np.abs(np.array(predictive.sd_ratio) - 1) < 0.25)
    assert predictive.correlation_of_correlations > 0.7
    assert summary.fit.largest_fraction_error < 1e-3 and not summary.fit.outside_prior


@pytest.mark.slow
def test_fitted_network_meets_the_target_fractions(campaign, tmp_path, tree):
    """The file that the stage writes, run anew, has the table's fractions, and these are the targets'."""
    chains = sampled(campaign, tmp_path)
    stage.gather(*campaign, chains, SMALL, 3, outputs(tmp_path))
    table, targets = read_csv(tmp_path / "fractions.csv"), read_json(campaign[2])
    wanted = np.array(targets["mean"]) / np.sum(targets["mean"])
    assert list(table["outlet"]) == targets["outlets"]
    assert np.allclose(table["target_fraction"], wanted)
    fitted = BedFlows(
        tmp_path / "fitted.json",
        {o.bc: o.vessel for o in read_case(campaign[0]).outlets},
        tolerance=1e-6,
        steps_per_cycle=None,
    )
    flows = fitted.flows(np.ones((1, 6)))[0]
    assert np.allclose(flows / flows.sum(), wanted, rtol=1e-4)
    assert np.allclose(table["fitted_error"], flows / flows.sum() / wanted - 1, atol=1e-5)
    assert np.allclose(fitted.resistances, table["fitted_resistance"])
    assert np.isclose(np.sum(1 / fitted.resistances), np.sum(1 / tree.beds))
    draws = read_csv(tmp_path / "draws.csv")
    assert np.allclose(draws[list(table["bc"])].mean(), table["posterior_multiplier"])


PLAIN = SMALL.model_copy(update={"emulator": EmulatorSettings(use=False), "dream": DreamSettings(generations=40)})


@pytest.mark.slow
@pytest.mark.parametrize("settings", [SMALL, DELAYED, PLAIN], ids=["independence", "delayed", "plain"])
def test_chains_made_longer_are_those_made_so_at_once(campaign, tmp_path, monkeypatch, settings):
    """Of three lengths, each continued from the file of the one before, and no run of the model is made twice."""
    counted, flows = [], BedFlows.flows
    monkeypatch.setattr(BedFlows, "flows", lambda self, m: counted.append(len(m)) or flows(self, m))
    at_once = sampled(campaign, tmp_path / "at once", settings, length=4)
    runs_at_once, before, files = sum(counted), None, []
    counted.clear()
    for length in (1, 2, 4):
        before = sampled(campaign, tmp_path / str(length), settings, length=length, before=before)
        files.append(Chains.read(before))
    same(at_once, before)
    assert sum(counted) == runs_at_once
    kept = [chains.kept_multipliers for chains in files]
    assert [k.shape[1] for k in kept] == [length * kept[0].shape[1] for length in (1, 2, 4)]
    for shorter, longer in zip(files, files[1:], strict=False):
        tables = [table_of_draws(chains, 100) for chains in (shorter, longer)]
        assert tables[0].equals(tables[1].iloc[: len(tables[0])]) and len(tables[1]) == 2 * len(tables[0])
        assert tables[1]["generation"].is_monotonic_increasing


@pytest.mark.slow
def test_chains_of_other_inputs_are_not_made_longer(campaign, tmp_path):
    other = sampled(campaign, tmp_path / "other", seed=4)
    same(sampled(campaign, tmp_path / "long", length=2, before=other), sampled(campaign, tmp_path / "new", length=2))


@pytest.mark.slow
def test_samples_extend_without_changing(campaign, tmp_path):
    chains = sampled(campaign, tmp_path)
    stage.gather(*campaign, chains, SMALL, 3, outputs(tmp_path))
    for count in (20, 50):
        stage.draw_samples(tmp_path / "draws.csv", SMALL, 3, "pilot", count, tmp_path / f"{count}.csv")
    stage.draw_samples(tmp_path / "draws.csv", SMALL, 3, "propagation", 20, tmp_path / "other.csv")
    short, long, other = (read_csv(tmp_path / f"{n}.csv") for n in ("20", "50", "other"))
    assert short.equals(long.iloc[:20])
    assert list(short.columns) == ["sample", "chain", "draw", *(f"BC_{i}" for i in range(6)), "R_cor_scaling"]
    assert not np.allclose(short["R_cor_scaling"], other["R_cor_scaling"])
    assert long["R_cor_scaling"].between(0.7, 1.25).all()
    assert long["sample"].is_unique


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "before", "after", "length"),
    [
        (DELAYED, None, None, 1),
        pytest.param(SMALL, None, 2, 2, marks=pytest.mark.long),
        pytest.param(SMALL, 3, 2, 1, marks=pytest.mark.long),
        pytest.param(DELAYED, 3, 1, 2, marks=pytest.mark.long),
    ],
)
def test_killed_run_continues_to_the_same_bits(campaign, tmp_path, kind, before, after, length):
    """SIGKILL to every process of the job soon after its first checkpoint; more ranks or fewer carry on.

    Chains of twice the length continue those of one.
    """
    settings = kind.model_copy(deep=True)
    settings.dream.generations, settings.independence.draws = 480, 120
    whole, more = sampled(campaign, tmp_path, settings, length=length), ()
    if length > 1:
        more = ("--length", str(length), "--before", str(sampled(campaign, tmp_path / "short", settings)))
    out = tmp_path / "killed" / "chains.npz"
    process = subprocess.Popen(
        command(campaign, out, before, settings, more), stderr=subprocess.DEVNULL, start_new_session=True
    )
    checkpoint = out.with_suffix("") / "checkpoint.npz"
    deadline = time.monotonic() + 240
    while not checkpoint.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    for number in reversed(descendants(process.pid)):
        with contextlib.suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)
    process.wait()
    assert checkpoint.exists() and not out.exists()
    subprocess.run(command(campaign, out, after, settings, more), check=True, stderr=subprocess.DEVNULL, timeout=500)
    same(whole, out)


def descendants(number):
    """A process and all that it has started, by number: MPI's launcher gives its ranks sessions of their own."""
    children = Path(f"/proc/{number}/task/{number}/children").read_text().split()
    return [number, *(one for child in children for one in descendants(int(child)))]


@pytest.mark.slow
def test_resume_from_every_checkpoint_and_with_torn_chain_files(campaign, tmp_path, monkeypatch):
    whole = sampled(campaign, tmp_path / "whole")

    class Killed(Exception):
        pass

    save = Recorder.save
    for stop in (1, 2, 3):
        calls = []

        def dying(self, state, calls=calls, stop=stop):
            calls.append(1)
            if len(calls) > stop:
                for chain in range(5):
                    values = {name: self.values[name][: self.done, chain] for name in RECORDED}
                    np.savez(self.folder / f"chain_{chain:03d}.npz", **values)
                raise Killed
            save(self, state)

        monkeypatch.setattr(Recorder, "save", dying)
        with pytest.raises(Killed):
            sampled(campaign, tmp_path / str(stop))
        monkeypatch.setattr(Recorder, "save", save)
        evaluated, flows = [], BedFlows.flows

        def counted(self, multipliers, evaluated=evaluated, flows=flows):
            evaluated.append(len(multipliers))
            return flows(self, multipliers)

        monkeypatch.setattr(BedFlows, "flows", counted)
        same(whole, sampled(campaign, tmp_path / str(stop)))
        monkeypatch.setattr(BedFlows, "flows", flows)
        assert sum(evaluated) < arrays(whole)["runs"]


@pytest.mark.slow
def test_checkpoint_of_other_inputs_is_not_continued(campaign, tmp_path):
    first = sampled(campaign, tmp_path, seed=1)
    one = arrays(first)
    two = arrays(sampled(campaign, tmp_path, seed=2))
    assert not np.array_equal(one["multipliers"], two["multipliers"])
    fresh = sampled(campaign, tmp_path / "fresh", seed=2)
    same(first, fresh)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "ranks"),
    [
        (DELAYED, 3),
        pytest.param(SMALL, 2, marks=pytest.mark.long),
        pytest.param(SMALL, 24, marks=pytest.mark.long),
    ],
)
def test_same_bits_for_any_number_of_ranks(campaign, tmp_path, settings, ranks):
    alone = sampled(campaign, tmp_path / "alone", settings)
    together = tmp_path / f"ranks{ranks}.npz"
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    subprocess.run(
        command(campaign, together, ranks, settings),
        check=True,
        stderr=subprocess.DEVNULL,
        env=environment,
        timeout=500,
    )
    same(alone, together)
    assert len(list(together.with_suffix("").glob("chain_*.npz"))) == 24


class Stepped(ResistorTree):
    """A tree whose flows jump by a factor with every resistance: no quadratic follows them."""

    def flows(self, multipliers):
        return super().flows(multipliers) * np.exp(0.05 * np.sign(np.sin(40 * multipliers)))


@pytest.mark.slow
def test_a_poor_emulator_leaves_the_chains_to_dream(tree, tmp_path, capsys):
    """Pilot runs find it out; those of delayed acceptance use all of them."""
    stepped = Stepped(tree.pressure, tree.shared, tree.epicardial, tree.beds)
    targets = stage.TargetFlows([f"BC_{i}" for i in range(6)], *targets_of(tree, 0.05))
    for kind, name in ((SMALL, "tried"), (DELAYED, "never")):
        kind = kind.model_copy(update={"dream": DreamSettings(generations=400)})
        stage.run_chains(stepped, stage.Unknowns(tree.weights), targets, kind, 3, tmp_path / f"{name}.npz", key=name)
    tried, never = Chains.read(tmp_path / "tried.npz"), Chains.read(tmp_path / "never.npz")
    assert not tried.independent and tried.pilot_k_hat > 0.5 and np.isnan(never.pilot_k_hat)
    warning = tried.refused
    assert "should be below" in warning
    assert f"warning: DREAM without independence steps: {warning}" in capsys.readouterr().err
    assert tried.every == never.every == DELAYED.emulator.generations and tried.generations == never.generations
    pilots = (arrays(tmp_path / f"{name}.npz")["checkpoint.prepared.runs"] for name in ("tried", "never"))
    assert np.subtract(*pilots) == 1200
    assert not np.array_equal(tried.emulator_error, never.emulator_error), "its emulator is fitted to pilots as well"
    summary = summarise(tried, SMALL, 3, 10, ReferenceShares({}, {}, 0.0), provenance={})
    assert not summary.independence.used and summary.independence.warning.startswith(warning)
    assert summary.model_runs == tried.runs


@pytest.mark.slow
def test_papers_rescaling_is_offered(campaign, tmp_path):
    settings = SMALL.model_copy(update={"constraint": "rescaled"})
    chains = arrays(sampled(campaign, tmp_path, settings))
    assert not chains["emulated"]
    moved = np.ptp(chains["multipliers"], axis=1).min(axis=1) > 0
    assert moved.any()
    assert np.allclose(np.sum(chains["weights"] / chains["multipliers"], axis=2), 1)


def test_a_bed_that_the_loop_lacks_is_reported(campaign, tmp_path):
    case = read_json(campaign[0])
    case["outlets"][2]["bc"] = "BC_other"
    write_json(campaign[0], case)
    with pytest.raises(InputError, match="bc = 'BC_2': no such outlet"):
        sampled(campaign, tmp_path)


def test_singular_covariance_is_refused(campaign, tmp_path):
    targets = read_json(campaign[2])
    targets["covariance"][0] = targets["covariance"][1]
    write_json(campaign[2], targets)
    with pytest.raises(InputError, match="covariance"):
        sampled(campaign, tmp_path)


@pytest.mark.slow
def test_unreachable_targets_are_reported(campaign, tmp_path, capsys, tree):
    targets = read_json(campaign[2])
    targets["mean"][0] *= 6
    write_json(campaign[2], targets)
    write_json(campaign[1], network_of(tree))
    chains = sampled(campaign, tmp_path)
    assert "outside the prior" in capsys.readouterr().err
    stage.gather(*campaign, chains, SMALL, 3, outputs(tmp_path))
    assert "BC_0" in read_summary(tmp_path / "summary.json").fit.outside_prior
