"""Cases for tests of the search."""

import pandas as pd
import pytest

from coronaryuq.cli import main
from coronaryuq.core.errors import InputError


@pytest.fixture
def error_of(stenosis_case, tmp_path, capsys):
    """Error of the command for the stenosis case with a changed table: one line, and nothing is written."""

    def run(change):
        for name in ("model.json", "conditions.yaml"):
            (tmp_path / name).write_text((stenosis_case[0] / name).read_text())
        table = pd.read_csv(stenosis_case[0] / "measurements.csv")
        change(table).to_csv(tmp_path / "measurements.csv", index=False)
        paths = ("--model", "model.json", "--measurements", "measurements.csv", "--conditions", "conditions.yaml")
        words = [word if word.startswith("--") else str(tmp_path / word) for word in (*paths, "--out", "out")]
        assert main.main(["discrepancy", *words]) == InputError.EXIT_CODE
        output, line = capsys.readouterr()
        assert not output and not (tmp_path / "out").exists()
        assert line.startswith("error: ") and line.count("\n") == 1
        return line

    return run
