"""The examples of CONTRIBUTING.md run."""

import re
from pathlib import Path

import numpy as np
import pytest

from coronaryuq.core import records
from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.adapter import Outputs, Sample

PAGE = Path(__file__).parents[1] / "CONTRIBUTING.md"


@pytest.fixture(scope="module")
def examples():
    """Names defined by all examples, in order."""
    names: dict = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL):
        exec(compile(block, PAGE.name, "exec"), names)
    return names


def test_the_effect_raises_the_resistance_by_its_size(examples):
    effect = examples["StentResistance"]()

    class OneVessel:
        def vessel_values(self, name):
            return {"R_poiseuille": 100.0}

    changes = effect.changes(OneVessel(), "lad", {"excess": np.array([0.0, 0.5])}, None, None)
    assert changes["lad.R_poiseuille"].tolist() == [100.0, 150.0]
    assert "Parameters" in effect.__doc__


def test_the_reader_names_what_is_wrong(examples, tmp_path):
    path = tmp_path / "radii.txt"
    path.write_text("0.2\n0.1\n")
    assert examples["read_radii"](path).tolist() == [0.2, 0.1]
    path.write_text("0.2\nwide\n")
    with pytest.raises(InputError, match="one number per line"):
        examples["read_radii"](path)


def test_the_solver_writes_a_record_per_sample(examples, tmp_path):
    samples = [Sample("a", 0, {"r": 1.0}), Sample("b", 1, {"r": 2.0})]
    examples["ConstantSolver"]().run(samples, Outputs(tmp_path / "records.jsonl", tmp_path))
    assert [record.sample for record in records.read(tmp_path / "records.jsonl")] == ["a", "b"]


def test_the_figure_is_drawn(examples, tmp_path):
    (tmp_path / "runs.csv").write_text("ffr_lad\n0.8\n0.9\n")
    examples["ffr_histogram"](tmp_path / "runs.csv", str(tmp_path / "f.png"))
    assert (tmp_path / "f.png").stat().st_size > 0
