"""The models of a campaign, asked by UM-Bridge's own client of a server that runs in a process of its own."""

import json
import socket
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
import pytest
import requests

from coronaryuq.campaign.results import ResultsFolder
from coronaryuq.case.case_json import read_case
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.cli.main import main
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import read_csv
from coronaryuq.perfusion.targets import of_borders, read_perfusion_targets, supplied
from coronaryuq.posterior.model.tissue import PerGram, Tissue
from coronaryuq.posterior.results import Chains
from coronaryuq.serve.models import LogLikelihood, models_of
from coronaryuq.zerod.settings import Settings
from coronaryuq.zerod.stage import run_chunk
from support.served import served, small_campaign

umbridge = pytest.importorskip("umbridge", reason="needs umbridge, which is not installed")
pytestmark = pytest.mark.slow

THETA = [[1.1, 0.9, 1.2, 1.05], [0.7, 1.4, 0.9, 1.0], [1.0, 1.0, 1.0, 1.0], [1.9, 0.6, 0.8, 1.2], [0.8, 1.1, 0.8, 0.9]]


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    return small_campaign(tmp_path_factory.mktemp("served"))


@pytest.fixture(scope="module")
def server(home):
    with served(home) as started:
        yield started


def names(url, model):
    info = requests.post(f"{url}/ModelInfo", json={"name": model}, timeout=60).json()
    return info["inputNames"], info["outputNames"]


def test_the_server_says_what_it_serves_and_what_is_missing(server):
    url, lines = server
    assert umbridge.supported_models(url) == ["zerod", "loglikelihood"]
    assert url.startswith("http://127.0.0.1:")
    assert "not served: " in lines[0] and "run the campaign, or its target results/tiny/mesh/mesh.json" in lines[0]
    assert any(line.startswith("zerod: 4 inputs, ") and line.endswith("up to 8 at once") for line in lines)


def test_parallel_requests_give_the_bits_of_the_campaigns_own_runs(server, home, tmp_path):
    url, _ = server
    model = umbridge.HTTPModel(url, "zerod")
    inputs, outputs = names(url, "zerod")
    assert inputs == ["BC_0", "BC_1", "BC_2", "R_cor_scaling"]
    assert model.get_input_sizes() == [4] and model.get_output_sizes() == [len(outputs)]
    with ThreadPoolExecutor(6) as threads:
        answers = list(threads.map(lambda row: model([row])[0], THETA))
    table = pd.DataFrame(THETA, columns=inputs)
    table.insert(0, "sample", [f"s{k}" for k in range(len(THETA))])
    table.to_csv(tmp_path / "samples.csv", index=False)
    files = home / "calibration" / "hyperaemia.json", home / "case" / "case.json", tmp_path / "samples.csv"
    run_chunk(*files, 0, len(THETA), Settings(batch=1), tmp_path / "runs.parquet")
    own = pd.read_parquet(tmp_path / "runs.parquet")
    assert np.array_equal(np.array(answers), own[outputs].to_numpy())
    assert 0.3 < answers[0][outputs.index("ffr_lad")] < 1.0


def test_the_served_model_is_a_backend_with_the_same_bits(server, home, tmp_path):
    url, _ = server
    inputs = ["R_cor_scaling", "BC_2", "BC_1", "BC_0"]  # the backend puts them in the server's order
    table = pd.DataFrame([row[::-1] for row in THETA], columns=inputs)
    table.insert(0, "sample", [f"s{k}" for k in range(len(THETA))])
    table.to_csv(tmp_path / "samples.csv", index=False)
    files = home / "calibration" / "hyperaemia.json", home / "case" / "case.json", tmp_path / "samples.csv"
    run_chunk(*files, 0, len(THETA), Settings(), tmp_path / "own.parquet")
    run_chunk(*files, 0, len(THETA), Settings(backend="umbridge", umbridge={"url": url}), tmp_path / "remote.parquet")
    own, remote = (pd.read_parquet(tmp_path / f"{name}.parquet") for name in ("own", "remote"))
    assert (remote["status"] == "ok").all()
    outputs = [name for name in remote if ":" in name or name.startswith("ffr_")]
    assert len(outputs) > 10 and np.array_equal(remote[outputs], own[outputs])


def test_the_log_likelihood_is_the_chains_up_to_the_prior(server, home):
    url, _ = server
    chains = Chains.read(home / "posterior" / "length_1" / "chains.npz")
    states = chains.kept_multipliers.reshape(-1, 3)[::7]
    density = chains.kept_log_density.reshape(-1)[::7]
    model = umbridge.HTTPModel(url, "loglikelihood")
    assert names(url, "loglikelihood")[0] == chains.names
    likelihood = np.array([model([list(map(float, state))])[0][0] for state in states])
    prior = 2.0 * np.log(states).sum(axis=1)
    assert len(np.unique(density)) > 5
    assert np.ptp(density - likelihood - prior) < 1e-6 * np.abs(likelihood).max()


def test_the_log_likelihood_takes_the_total_resistance_where_the_chains_inferred_it(tmp_path):
    home = small_campaign(tmp_path, errors=RoutineErrors().model_dump())
    chains = Chains.read(home / "posterior" / "length_1" / "chains.npz")
    assert chains.parameter_names == ["R_cor_scaling"]
    model = LogLikelihood(ResultsFolder(home))
    assert model.inputs == [*chains.names, "R_cor_scaling"]
    states = np.concatenate([chains.kept_multipliers, chains.kept_parameters], axis=2).reshape(-1, 4)[::7]
    density = chains.kept_log_density.reshape(-1)[::7]
    held = read_perfusion_targets(home / "perfusion" / "targets.json")
    arteries = [outlet.branch for outlet in read_case(home / "case" / "case.json").outlets]
    errors = RoutineErrors()
    borders = of_borders(held)
    tissue = Tissue(supplied(held), arteries, errors.microvascular, errors.microvascular_correlation, borders)
    space = PerGram(chains.weights, tissue)
    prior = space.log_prior(space.coordinates(states[:, :3] * states[:, 3:]))
    likelihood = np.array([value for (value,) in model.run(states)])
    assert len(np.unique(density)) > 5
    np.testing.assert_allclose(density, likelihood + prior, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    ("theta", "line"),
    [
        ([[1.0, 1.0, 1.0, -1.0]], "R_cor_scaling = -1.0: expected a positive number"),
        ([[1.0, 1.0, 1.0, float("nan")]], "R_cor_scaling = nan: expected a positive number"),
        ([[1.0, "one", 1.0, 1.0]], "BC_1 = 'one': expected a positive number"),
        ([[1.0, 1.0]], "input: 2 numbers in place of 4: BC_0, BC_1, BC_2, R_cor_scaling"),
        ([[1.0], [1.0], [1.0]], "input: expected one vector of 4 numbers"),
    ],
)
def test_wrong_inputs_are_answered_with_one_line(server, theta, line):
    url, _ = server
    body = json.dumps({"name": "zerod", "input": theta, "config": {}})
    answer = requests.post(f"{url}/Evaluate", data=body, timeout=60)
    error = answer.json()["error"]
    assert answer.status_code == 400 and error["type"] == "InvalidInput"
    assert error["message"].startswith(line) and "\n" not in error["message"]
    with pytest.raises(Exception, match="InvalidInput"):
        umbridge.HTTPModel(url, "zerod")([[0.0, 1.0, 1.0, 1.0]])


@pytest.mark.parametrize(
    ("path", "body", "kind", "line"),
    [
        ("Evaluate", "{", "InvalidInput", "the request is not JSON"),
        ("Evaluate", "[]", "InvalidInput", "the request is not a JSON object"),
        ("Evaluate", '{"name": "flow3d"}', "ModelNotFound", "no model 'flow3d'; served are zerod, loglikelihood"),
        ("InputSizes", '{"name": "zerod", "config": {"steps": 3}}', "InvalidInput", "config = {'steps': 3}: "),
        ("Gradient", '{"name": "zerod"}', "UnsupportedFeature", "zerod has no derivatives"),
    ],
)
def test_other_wrong_requests_too(server, path, body, kind, line):
    error = requests.post(f"{server[0]}/{path}", data=body, timeout=60).json()["error"]
    assert error["type"] == kind and error["message"].startswith(line)


def test_a_folder_that_is_no_campaign_and_a_port_in_use_are_one_line(home, tmp_path, capsys):
    assert main(["serve", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith(f"error: {tmp_path}: not the results folder of a campaign")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert main(["serve", str(home), "--port", str(taken.getsockname()[1])]) == 2
    assert "address already in use; choose another" in capsys.readouterr().err


def test_models_take_their_inputs_from_the_draws(home):
    models, _ = models_of(home)
    draws = read_csv(home / "posterior" / "draws.csv")
    assert models[0].inputs[:-1] == [name for name in draws if name.startswith("BC_")]
    assert read_json(home / "case" / "case.json")["name"] == "tiny"
