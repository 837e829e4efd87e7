"""The benchmark resumes from its lines, and a whole patient runs from its drawing to its score."""

import json

import pytest

from coronaryuq.bench.endtoend import benchmark
from coronaryuq.bench.endtoend.benchmark import Lines, beside_0d, run
from coronaryuq.core.errors import InputError

HEAD = {"seed": 1, "noise": 1.0, "truth": "default", "stated": "abc"}
DEFAULTS = {
    "patients": 1, "first": 0, "seed": 1, "setting": "paper", "noise": 1.0, "truth": "default", "truth_only": False,
    "config": None, "cores": 2, "resume": None,
}  # fmt: skip


def line(index: int, setting: str = "paper") -> dict:
    return {
        "index": index, "setting": setting, "vessels": {}, "failed": None, "rhat_max": None, "converged": None,
        "cpu_s": 0.0,
    }  # fmt: skip


def test_finished_lines_are_found_again_and_an_incomplete_one_is_dropped(tmp_path):
    path = tmp_path / "patients.jsonl"
    first = Lines(path, HEAD)
    first.add(line(0))
    first.add(line(1, "full"))
    with open(path, "a") as file:
        file.write('{"index": 2, "sett')
    again = Lines(path, HEAD)
    assert set(again.found) == {(0, "paper"), (1, "full")}
    again.add(line(2))
    texts = path.read_text().splitlines()
    assert [json.loads(text).get("index") for text in texts] == [None, 0, 1, 2]


@pytest.mark.parametrize("name", list(HEAD))
def test_lines_of_other_patients_are_refused_and_kept(tmp_path, name):
    path = tmp_path / "patients.jsonl"
    Lines(path, HEAD).add(line(0))
    before = path.read_bytes()
    with pytest.raises(InputError, match=f"{name} differs from what is asked for"):
        Lines(path, HEAD | {name: "other"})
    assert path.read_bytes() == before


@pytest.mark.parametrize("content", ["some text\n", '{"a": 1}\n', '{"stated": "abc"}\n{"index": 1}\n', "[1]\n"])
def test_another_file_is_refused_and_kept(tmp_path, content):
    path = tmp_path / "other.jsonl"
    path.write_text(content)
    with pytest.raises(InputError, match="no patients of this benchmark"):
        Lines(path, HEAD)
    assert path.read_text() == content


def test_only_what_is_missing_is_run(tmp_path, monkeypatch):
    asked = []

    def made(index, settings, options, configuration):
        asked.append((index, list(settings)))
        yield from (line(index, setting) for setting in settings)

    monkeypatch.setattr(benchmark, "_lines", made)
    options = DEFAULTS | {"patients": 3, "resume": str(tmp_path / "patients.jsonl")}
    run(**options)
    found = run(**options | {"setting": "both", "patients": 4})
    assert asked == [
        (0, ["paper"]),
        (1, ["paper"]),
        (2, ["paper"]),
        *((k, ["full"]) for k in range(3)),
        (3, ["full", "paper"]),
    ]
    assert found["setting"] == "full" and found["patients"] == found["paper"]["patients"] == 4


def test_differences_of_0d_from_the_truth():
    levels = {"LAD": {"ffr_0d": 0.83, "ffr_trained": 0.80}, "RCA": {"ffr_0d": 0.86, "ffr_trained": 0.90}}
    found = beside_0d([{"truth": {"ffr_lad": 0.80, "ffr_rca": 0.90}, "levels": levels}, {"vessels": {}}])
    assert found["ffr_0d"] == {"vessels": 2, "rms": pytest.approx(0.05 / 2**0.5), "largest": pytest.approx(-0.04)}
    assert found["ffr_trained"]["rms"] == pytest.approx(0.0)


def test_nonsense_is_refused():
    with pytest.raises(InputError, match="--noise"):
        run(**DEFAULTS | {"noise": -1.0})
    with pytest.raises(InputError, match="--patients"):
        run(**DEFAULTS | {"patients": 0})


@pytest.mark.long
def test_a_whole_patient():
    found = run(**DEFAULTS | {"first": 8})
    assert (found["failed"], found["patients"], found["vessels"]) == (0, 1, 1)
    (ffr,) = [answer["ffr"] for answer in found["lines"][0]["vessels"].values()]
    assert 0.2 < ffr["truth"] < 1.0 and 0.0 <= ffr["below"] <= 1.0
    values = [ffr["quantiles"][share] for share in ("0.05", "0.25", "0.50", "0.75", "0.95")]
    assert values == sorted(values) and values[0] > 0.1 and values[-1] < 1.2
    assert {row["quantity"] for row in found["quantities"]} >= {"ffr", "tawss_patch_min", "osi_patch_max"}
