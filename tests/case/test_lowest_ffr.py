"""The lowest FFR of an artery is sought at the ends of its branches and where FFR of its stenoses is read."""

import numpy as np

from coronaryuq.case.lowest_ffr import FfrPlaces, ffr_places, lowest_ffr
from support.case_files import case_summary

UNKNOWNS = ["flow:lca1:BC_lca1", "pressure:lca1:BC_lca1", "pressure:lca2_downstream:BC_lca2", "pressure:J0:lca1"]
"""As of a loop whose vessel lca2 a mesh cuts."""


def case(*outlets):
    stenoses = [{}, {"name": "LM", "artery": "LM"}]
    return case_summary(outlets=[{"name": name, "branch": branch} for name, branch in outlets], stenoses=stenoses)


def test_an_end_is_found_by_its_bed_whatever_the_vessel_ahead_is_called():
    found = ffr_places(case(("lca1", "LAD"), ("lca2", "LAD")), UNKNOWNS)
    assert found == {"LAD": FfrPlaces(("pressure:lca1:BC_lca1", "pressure:lca2_downstream:BC_lca2"), ("LAD",))}


def test_an_artery_of_which_the_network_lacks_a_bed_is_left_out():
    assert list(ffr_places(case(("lca1", "LAD"), ("rca1", "RCA")), UNKNOWNS)) == ["LAD"]


def test_each_state_has_its_own_place_of_the_lowest():
    places = {"LAD": FfrPlaces(("a", "b"), ("LAD", "LAD2"))}
    at_ends = {"a": np.array([0.9, 0.8, 0.9]), "b": np.array([0.7, 0.9, 0.9]), "c": np.zeros(3)}
    found = lowest_ffr(places, at_ends, {"LAD": np.array([0.95, 0.95, 0.6])})
    assert found.keys() == {"lowest_ffr_lad"} and found["lowest_ffr_lad"].tolist() == [0.7, 0.8, 0.6]
