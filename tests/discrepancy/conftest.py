"""Cases for tests of the search."""

import pandas as pd
import pytest

from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import hide
from coronaryuq.cli import main
from coronaryuq.core.errors import InputError


@pytest.fixture(scope="session")
def stenosis_case(tmp_path_factory):
    """Folder of a case with a hidden stenosis, and what was hidden."""
    folder = tmp_path_factory.mktemp("case")
    truth, _ = hide(Case(("quadratic_stenosis",), "medium", "nominal", 5), open_loop(), folder)
    return folder, truth


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
