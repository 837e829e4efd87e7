"""Models of a foreign UM-Bridge server, which really runs, as 3D and as 0D backend."""

import json

import numpy as np
import pandas as pd
import pytest

from coronaryuq.config import Campaign
from coronaryuq.core import records
from coronaryuq.core.errors import InputError
from coronaryuq.core.remote_model import RemoteModel, RemoteSettings
from coronaryuq.flow3d.adapter import Outputs, Sample
from coronaryuq.flow3d.umbridge import UmbridgeAdapter
from coronaryuq.zerod.settings import Settings
from coronaryuq.zerod.stage import run_chunk
from support.case_files import write_case_json
from support.foreign_server import OUTPUTS, answer, foreign_server
from support.resistor_tree import ResistorTree, network_of

pytest.importorskip("umbridge", reason="needs umbridge, which is not installed")


@pytest.fixture(scope="module")
def url():
    with foreign_server() as address:
        yield address


def sample(k: int, *theta: float) -> Sample:
    return Sample(f"pilot_{k}", k, dict(zip(("BC_0", "R_cor_scaling"), theta, strict=True)))


def test_a_foreign_model_gives_3d_records_in_order_and_a_failed_sample_its_reason(url, tmp_path):
    adapter = UmbridgeAdapter(RemoteSettings(url=url, outputs=OUTPUTS, parallel=2))
    samples = [sample(0, 1.0, 1.1), sample(1, 9.0, 1.0), sample(2, 0.6, 0.9), sample(3, 2.0, 1.2), sample(4, 1.5, 1.0)]
    out = Outputs(tmp_path / "records.jsonl", tmp_path / "checkpoints")
    adapter.run(samples, out)
    found = records.read(out.records)
    assert [record.sample for record in found] == [s.name for s in samples]
    for record, asked in zip(found, samples, strict=True):
        assert record.inputs == dict(asked.theta) and record.solver["version"] == f"flow3d at {url}"
        if asked.row == 1:
            assert not record.ok and "the server answered without a result" in record.reason
        else:
            assert list(record.outputs.values()) == answer(list(asked.theta.values()))
    assert not list(out.checkpoints.iterdir())


def test_a_killed_batch_asks_only_for_what_is_missing(url, tmp_path):
    adapter = UmbridgeAdapter(RemoteSettings(url=url, outputs=OUTPUTS))
    samples = [sample(0, 1.0, 1.1), sample(1, 0.6, 0.9), sample(2, 0.7, 0.8)]
    kept = records.Record("pilot_0", dict(samples[0].theta), {"ffr_lad": 0.123})
    other = records.Record("pilot_1", {"BC_0": 5.0, "R_cor_scaling": 1.0}, {"ffr_lad": 0.456})
    records.write(tmp_path / "checkpoints" / "umbridge_0.jsonl", [kept, other])
    adapter.run(samples, Outputs(tmp_path / "records.jsonl", tmp_path / "checkpoints"))
    found = records.read(tmp_path / "records.jsonl")
    assert found[0].outputs == {"ffr_lad": 0.123}
    assert [list(record.outputs.values()) for record in found[1:]] == [answer([0.6, 0.9]), answer([0.7, 0.8])]


def test_a_foreign_model_gives_the_rows_of_the_0d_stage(url, tmp_path):
    (tmp_path / "network.json").write_text(json.dumps(network_of(ResistorTree.of(1))))
    write_case_json(tmp_path / "case.json", outlets=[{"name": "v0", "bc": "BC_0"}])
    theta = pd.DataFrame({"sample": ["a", "b", "c"], "BC_0": [1.0, 7.0, 0.5], "R_cor_scaling": [1.0, 1.0, 1.2]})
    theta.to_csv(tmp_path / "samples.csv", index=False)
    settings = Settings(backend="umbridge", umbridge=RemoteSettings(url=url, model="mine", outputs=OUTPUTS))
    files = tmp_path / "network.json", tmp_path / "case.json", tmp_path / "samples.csv"
    run_chunk(*files, 0, 3, settings, tmp_path / "out.parquet")
    rows = pd.read_parquet(tmp_path / "out.parquet")
    assert list(rows["status"]) == ["ok", "failed", "ok"] and rows["sample"].tolist() == ["a", "b", "c"]
    assert rows.loc[[0, 2], OUTPUTS].to_numpy().tolist() == [answer([1.0, 1.0]), answer([0.5, 1.2])]
    assert rows.loc[1, OUTPUTS].isna().all() and rows.loc[1, "reason"]


@pytest.mark.parametrize(
    ("settings", "name", "line"),
    [
        ({}, "flow3d", "flow3d.umbridge.outputs: the server does not name its 3 outputs; name them here"),
        ({"outputs": ["ffr_lad"]}, "flow3d", "1 names, but the model has 3 outputs"),
        ({"outputs": OUTPUTS}, "other", "not on the server; it has flow3d, mine, two"),
        ({"outputs": OUTPUTS}, "two", "has 2 vectors of inputs; expected one"),
    ],
)
def test_what_does_not_fit_is_one_line(url, settings, name, line):
    with pytest.raises(InputError) as caught:
        RemoteModel(RemoteSettings(url=url, **settings), name, "flow3d.umbridge")
    assert line in str(caught.value) and "\n" not in str(caught.value)


def test_other_inputs_than_the_models_are_one_line(url):
    model = RemoteModel(RemoteSettings(url=url, outputs=OUTPUTS), "mine", "zerod.umbridge")
    with pytest.raises(InputError, match="its inputs are 2 numbers; the campaign has BC_0, BC_1, R_cor_scaling"):
        model.evaluate(np.ones((1, 3)), ["BC_0", "BC_1", "R_cor_scaling"])


def test_a_server_that_is_not_there_is_one_line():
    with pytest.raises(InputError, match="zerod.umbridge.url = .*no UM-Bridge server answers there"):
        RemoteModel(RemoteSettings(url="http://127.0.0.1:9"), "zerod", "zerod.umbridge")


def test_a_configuration_names_the_server():
    blocks = {"backend": "umbridge", "zerod": {"backend": "umbridge", "umbridge": {"url": "http://node7:4242"}}}
    assert Campaign(name="x", **blocks).zerod.umbridge.url == "http://node7:4242"
    with pytest.raises(ValueError, match="String should match pattern"):
        Campaign(name="x", flow3d={"umbridge": {"url": "node7"}})
