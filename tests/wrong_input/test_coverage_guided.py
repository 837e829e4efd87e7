"""Coverage-guided fuzzing (atheris, libFuzzer) of every reader of text; run by hand.

Each reader is fuzzed for `FUZZ_SECONDS` (default 20) from one valid example; it may only raise InputError.
"""

import os
import subprocess
import sys

import pytest

pytest.importorskip("atheris", reason="needs atheris, which is not installed")

pytestmark = pytest.mark.long

READERS = {
    "campaign.yaml": "coronaryuq.config.load",
    "case.yaml": "coronaryuq.case.description.fields.read_description",
    "conditions.yaml": "coronaryuq.discrepancy.data.conditions.read_conditions",
    "model.json": "coronaryuq.zerod.network.read.read_network",
    "case/case.json": "coronaryuq.case.case_json.read_case",
    "batch_0.jsonl": "coronaryuq.core.records.read",
    "outlets.csv": "coronaryuq.case.tables.read.read_outlets",
    "targets.csv": "coronaryuq.case.tables.read.read_case_targets",
    "mesh-complete.zip": "coronaryuq.flow3d.mesh.generation.folder.unpack",
}

GUIDED = """
import importlib, sys, tempfile
from pathlib import Path
import atheris

name, reader, seconds, corpus = sys.argv[1:5]
module, _, function = reader.rpartition(".")
with atheris.instrument_imports(include=["coronaryuq"]):
    read = getattr(importlib.import_module(module), function)
from coronaryuq.core.errors import InputError

folder = Path(tempfile.mkdtemp())
path = folder / Path(name).name
more = (folder / "out",) if function == "unpack" else ()


def once(data):
    path.write_bytes(data)
    try:
        read(path, *more)
    except InputError as error:
        assert "\\n" not in str(error) and path.name in str(error), error
    assert {p.name for p in folder.iterdir()} <= {path.name, "out"}, "something was written"


options = [f"-max_total_time={seconds}", "-rss_limit_mb=3000", "-max_len=20000", "-verbosity=0", "-print_final_stats=1"]
atheris.Setup([sys.argv[0], *options, corpus], once)
atheris.Fuzz()
"""


@pytest.mark.parametrize("name", READERS)
def test_a_reader_accepts_its_input_or_reports_the_fault_on_one_line(valid, tmp_path, name):
    (tmp_path / "corpus").mkdir()
    (tmp_path / "corpus" / "valid").write_bytes((valid / name).read_bytes())
    seconds = os.environ.get("FUZZ_SECONDS", "20")
    command = [sys.executable, "-c", GUIDED, name, READERS[name], seconds, str(tmp_path / "corpus")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    print(*(line for line in done.stderr.splitlines() if "stat::number" in line))
    assert done.returncode == 0, done.stderr[-3000:]
