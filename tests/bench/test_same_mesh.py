"""Same-mesh costs: what is asked for is read before anything is run; the programs themselves are not always there."""

import pytest

from coronaryuq.bench.flow3d import same_mesh
from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.settings import Settings


def test_a_program_and_its_steps_are_read():
    assert same_mesh.chosen("svsolver:12") == ("svsolver", 12)


@pytest.mark.parametrize("program", ["svsolver", "svsolver:", "svsolver:0", "svsolver:-1", "fluent:3"])
def test_anything_else_is_rejected_before_a_run(program, tmp_path):
    with pytest.raises(InputError, match="PROGRAM:STEPS"):
        same_mesh.compare(tmp_path, [program], Settings())


def test_a_folder_without_a_campaign_is_rejected_by_name(tmp_path):
    with pytest.raises(InputError, match="case.json: no such file"):
        same_mesh.compare(tmp_path, [], Settings())
