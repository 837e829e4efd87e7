"""What is checked before training and estimation."""

import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.training import read_chosen


@pytest.mark.parametrize(
    ("groups", "reason"),
    [({"beds": ["BC_lca1", "BC_lca9"]}, "no such input"), ({"a": ["BC_lca1"], "b": ["BC_lca1"]}, "is in two groups")],
)
def test_a_group_of_inputs_that_cannot_be_formed_gets_one_line(folder, groups, reason):
    with pytest.raises(InputError, match=reason):
        read_chosen(folder, None, Settings(input_groups=groups))
