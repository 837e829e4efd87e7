"""A file that cannot be written is reported on one line; no partial file remains."""

import contextlib
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from coronaryuq.cli import main
from coronaryuq.core.command_line import run_with_settings
from coronaryuq.core.io.atomic import replacing, write_json, write_text
from coronaryuq.core.io.tables import write_csv
from coronaryuq.flow3d.settings import Settings

REPOSITORY = Path(__file__).parents[3]
NO_ROOM = "No space left on device: free some space there and run again\n"


@pytest.fixture
def disk(tmp_path):
    """A file system of 256 kB, and a function that changes its options."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256k", "none", str(folder)], capture_output=True).returncode:
        pytest.skip("needs the right to mount a small file system")
    try:
        yield folder, lambda option: subprocess.run(["mount", "-o", f"remount,{option}", str(folder)], check=True)
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def arrays(path):
    with replacing(path) as beside:
        np.savez(beside, values=np.zeros(100_000))


def packed(path):
    with replacing(path) as beside, zipfile.ZipFile(beside, "w") as archive:
        archive.writestr("values", bytes(1_000_000))


def parquet(path):
    with replacing(path) as beside:
        pd.DataFrame({"x": np.random.default_rng(1).random(100_000)}).to_parquet(beside)


WRITERS = {
    "t.json": lambda path: write_json(path, list(range(100_000))),
    "t.csv": lambda path: write_csv(path, pd.DataFrame({"x": np.arange(100_000)})),
    "t.npz": arrays,
    "t.zip": packed,
    "t.parquet": parquet,
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_is_reported_on_one_line(disk, capsys, name):
    folder, _ = disk
    write_text(folder / name, "before")
    assert run_with_settings(lambda settings: WRITERS[name](folder / name), Settings, "{}") == 2
    assert capsys.readouterr().err == f"error: {folder / name}: {NO_ROOM}"
    assert [path.name for path in folder.iterdir()] == [name] and (folder / name).read_text() == "before"


def test_a_read_only_folder_is_reported_on_one_line(disk, capsys):
    folder, remount = disk
    remount("ro")
    assert run_with_settings(lambda settings: write_json(folder / "a" / "t.json", 1), Settings, "{}") == 2
    line = capsys.readouterr().err
    assert line.startswith(f"error: {folder / 'a'}") and "Read-only file system: name a folder elsewhere" in line


def test_a_command_reports_a_full_disk_on_one_line(disk, capsys, monkeypatch):
    folder, _ = disk
    monkeypatch.setattr("coronaryuq.cli.check.check", lambda path: WRITERS["t.csv"](folder / "t.csv"))
    assert main.main(["check", "case.yaml"]) == 2
    assert capsys.readouterr().err == f"error: {folder / 't.csv'}: {NO_ROOM}"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["t.vtu", "t.vtp"])
def test_a_job_reports_a_full_disk_on_one_line_also_for_meshes(disk, tmp_path, name):
    """In a process of its own: VTK's writers bring it down on a full disk."""
    folder, _ = disk
    with contextlib.suppress(OSError):
        (folder / "rest").write_bytes(bytes(2**20))
    (tmp_path / "writer.py").write_text(f"""
import numpy as np, pyvista as pv
from coronaryuq.core.io.vtk import write_vtk

def write():
    points = np.random.default_rng(1).random((100_000, 3))
    mesh = pv.PolyData(points) if {name!r} == "t.vtp" else pv.PolyData(points).cast_to_unstructured_grid()
    write_vtk({str(folder / name)!r}, mesh)
""")
    runner = [sys.executable, str(REPOSITORY / "workflow" / "scripts" / "stage.py")]
    done = subprocess.run(
        [*runner, "--params", '{"function": "writer:write"}', "--log", str(folder / "job.log")],
        env=os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{REPOSITORY / 'src'}"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr == f"write: started\nwrite: error: {folder / name}: {NO_ROOM}"
    assert not list(folder.glob(".*part*")) and not (folder / name).exists()
