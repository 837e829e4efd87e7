"""Files are complete or absent."""

import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, replacing, write_json


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    target = tmp_path / "table.json"
    write_json(target, {"a": 1})
    with pytest.raises(RuntimeError), replacing(target) as beside:
        beside.write_text("half")
        raise RuntimeError
    assert read_json(target) == {"a": 1}
    assert [path.name for path in tmp_path.iterdir()] == ["table.json"]


@pytest.mark.parametrize("text", ["", "{", '{"a": 1', "\x00\xff"])
def test_broken_json_is_reported_on_one_line(tmp_path, text):
    path = tmp_path / "case.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError) as caught:
        read_json(path)
    assert "case.json" in str(caught.value) and "\n" not in str(caught.value)
