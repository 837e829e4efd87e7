"""Quality of the 3D runs on the page."""

from coronaryuq.core import records
from coronaryuq.report.runs3d import quality


def test_powers_of_ten_are_not_broken_between_lines(tmp_path):
    diagnostics = [{"mass_balance": 8e-14, "cycles": 2, "change": change} for change in (0.001, 0.006)]
    runs = [records.Record(str(k), {}, {"ffr_lad": 0.8}, diagnostics=found) for k, found in enumerate(diagnostics)]
    records.write(tmp_path / "batch.jsonl", runs)
    change, balance, cycles = quality([str(tmp_path / "batch.jsonl")], 0.002)
    assert (balance["median"], balance["limit"]) == ("8e\u221214", "1e\u22126")
    assert (change["worst"], change["limit"], change["verdict"]) == ("0.006", "0.002", "1 of 2 runs within")
    assert (change["class"], balance["class"], cycles["limit"]) == ("warn", "good", "–")
