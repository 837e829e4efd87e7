"""One strict reader for text and JSON: encodings, keys given twice, hidden files."""

import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.text import read_text, visible


def test_a_mark_and_windows_line_ends_are_read(tmp_path):
    (tmp_path / "a").write_bytes("\ufeffa: \u00e4\r\nb: 1\r\n".encode())
    assert read_text(tmp_path / "a") == "a: \u00e4\r\nb: 1\r\n"


@pytest.mark.parametrize(
    "content",
    ["a\nM\u00fcller".encode("latin-1"), "a\nb".encode("utf-16"), "a\nb".encode("utf-16-le"), "a".encode("utf-32")],
    ids=["Latin-1", "UTF-16", "UTF-16 without mark", "UTF-32"],
)
def test_other_encodings_are_told_in_one_line(tmp_path, content):
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(InputError, match="not UTF-8 text; save the file in the encoding UTF-8"):
        read_text(tmp_path / "a")


@pytest.mark.parametrize("text", ['{"a": 1, "a": 2}', '{"x": [{"a": 1, "b": 2, "a": 1}]}'])
def test_a_key_twice_in_json_is_named(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=r"a\.json: a: given twice in one object; keep one"):
        read_json(tmp_path / "a.json")


def test_hidden_files_and_folders_are_not_seen(tmp_path):
    for name in ("b.csv", "a.csv", "._a.csv", ".c.csv"):
        (tmp_path / name).write_text("")
    (tmp_path / "folder.csv").mkdir()
    assert [path.name for path in visible(tmp_path, "*.csv")] == ["a.csv", "b.csv"]
