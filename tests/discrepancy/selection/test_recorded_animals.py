"""Recorded coronary flow of two animals, whose answer nobody knows: it may not hang on how the files are written."""

from pathlib import Path

import pytest
import yaml

from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.data.recordings import prepare_case
from coronaryuq.discrepancy.inference.read_problem import read_problem
from coronaryuq.discrepancy.selection.search import discover
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.network.read import read_network

RECORDINGS = Path(__file__).parents[4] / "shared" / "data" / "perfused-heart"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not RECORDINGS.is_dir(), reason=f"{RECORDINGS} is not there"),
]


def searched(folder):
    conditions = folder / "conditions.yaml"
    files = read_network(folder / "model.json"), folder / "measurements.csv"
    return discover(read_problem(*files, read_conditions(conditions), conditions, Settings()), 1)


def named(found):
    sizes = {one: [parameter.from_standard(z) for parameter, z, _ in found.sizes(one)] for one in found.hypothesis}
    return {effect.name: sizes[effect, place] for effect, place in (entry.accepted.placed for entry in found.named)}


def test_the_order_of_conditions_decides_nothing(tmp_path):
    prepare_case(RECORDINGS, "DSEA10", tmp_path, None, False)
    as_written = named(searched(tmp_path))
    assert {"diffuse_narrowing", "intramyocardial_pressure"} <= set(as_written)
    entries = yaml.safe_load((tmp_path / "conditions.yaml").read_text())
    first, *others = entries
    turned = {name: entries[name] for name in (first, *reversed(others))}
    (tmp_path / "conditions.yaml").write_text(yaml.safe_dump(turned, sort_keys=False))
    otherwise = named(searched(tmp_path))
    assert list(otherwise) == list(as_written)
    for name, sizes in as_written.items():
        assert otherwise[name] == pytest.approx(sizes, rel=0.05), name


def test_the_search_continues_after_a_held_out_rejection(tmp_path):
    prepare_case(RECORDINGS, "DSEA08", tmp_path, None, False)
    found = searched(tmp_path)
    refuted = [entry.refuted.placed.effect.name for entry in found.rounds if entry.refuted is not None]
    assert refuted == ["flow_delay"]
    assert set(named(found)) == {"diffuse_narrowing", "intramyocardial_pressure", "inertance"}
