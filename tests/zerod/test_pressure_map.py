"""Readings along a small case, run by the 0D model: those of a wire's places fit those at the nodes."""

import pandas as pd
import pytest

from coronaryuq.case.settings import Settings
from coronaryuq.case.stage import prepare_case
from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.report.predicted import read_predicted
from coronaryuq.zerod.pressure_map import write_map
from support.case_files import small_tree, write_case

END = small_tree().emergence("branch1")
WIRE = f"""
  - {{name: end, artery: LAD, distance: {3.2 - END + 4.0}, measured: 0.9, sd: 0.02}}
  - {{name: inside, point: [1.9, 0, 2], measured: 0.5}}
  - {{artery: RCA, distance: 2}}
"""


@pytest.mark.slow
def test_a_wires_places_are_read_from_the_runs_of_the_campaign(tmp_path):
    prepare_case(write_case(tmp_path, small_tree(), ffr_at=WIRE), Settings(), tmp_path / "case")
    factors = [0.15, 0.2, 0.25]
    beds = pd.DataFrame(dict.fromkeys(("BC_lca1", "BC_lca2", "BC_rca1"), factors))
    write_csv(tmp_path / "samples.csv", beds.assign(sample=range(3), R_cor_scaling=1.0))
    case = tmp_path / "case"
    out = [tmp_path / name for name in ("pressures.csv", "predicted.csv")]
    write_map(case / "network.json", case / "case.json", case / "tree.vtp", tmp_path / "samples.csv", *out)

    nodes, table = read_csv(out[0]), read_predicted(out[1]).set_index("name")
    places = table[table["quantity"] == "FFR at a place"]
    assert places.index.tolist() == ["end", "inside", "rca1 2.0 cm"]
    last = nodes[(nodes["vessel"] == "lca1") & (nodes["position"] == 1.0)].iloc[-1]
    end = places.loc["end"]
    assert [end["low"], end["median"], end["high"]] == pytest.approx(
        [last["ffr_low"], last["ffr"], last["ffr_high"]], abs=1e-12
    )
    assert 0.3 < end["low"] < end["median"] < end["high"] < 1.0
    assert end["expected_low"] < end["low"] and end["expected_high"] > end["high"]
    assert end["difference"] == pytest.approx(end["median"] - 0.9)
    inside = places.loc["inside"]
    start, end_of = nodes[nodes["vessel"] == "branch1"]["ffr"].iloc[[0, -1]]
    assert end_of < inside["median"] < start and inside["within"] == "no"
    assert inside["median"] == pytest.approx(start + (end_of - start) * (1.9 - END) / (3.2 - END), abs=1e-4)
    assert pd.isna(places.loc["rca1 2.0 cm", "within"])
