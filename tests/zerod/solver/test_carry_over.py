"""A state carried over to a network with added elements."""

import numpy as np

from coronaryuq.zerod.solver.carry_over import carry_over

NAMES = ["pressure:A:v", "flow:A:v", "pressure:v:BED", "flow:v:BED", "other"]
STATE = np.array([90.0, 4.0, 80.0, 3.0, 7.0])
RENAMED = {"v:BED": "v_tag:BED"}
"""A stub put behind the vessel v, ahead of its bed."""


def test_known_values_are_kept_under_their_new_names():
    found = carry_over(NAMES, STATE, ["flow:A:v", "pressure:v_tag:BED", "flow:v_tag:BED", "other"], RENAMED)
    assert found.tolist() == [4.0, 80.0, 3.0, 7.0]


def test_added_vessels_start_at_the_pressure_of_their_neighbours_without_flow():
    # Asked for from the far end: x hangs on y, y on the junction J, J on the end of v.
    wanted = ["pressure:x:END", "pressure:y:x", "pressure:J:y", "flow:J:y", "pressure:v:J", "pressure:A:v"]
    found = carry_over(NAMES, STATE, [*wanted, "pressure:far:away"], RENAMED)
    assert found.tolist() == [80.0, 80.0, 80.0, 0.0, 80.0, 90.0, 0.0]
