"""A result's sources are all the files it could depend on, and no others."""

import ast
from pathlib import Path

import pytest

import coronaryuq
from coronaryuq.core import provenance

PACKAGE = Path(coronaryuq.__file__).parent


def names(*modules):
    return {path.relative_to(PACKAGE).as_posix() for path in provenance.sources(*modules)}


def test_sources_follow_imports_to_the_ground():
    found = names("coronaryuq.core.records")
    assert {"__init__.py", "core/records.py", "core/errors.py", "core/io/atomic.py"} <= found


def test_sources_leave_out_what_is_not_imported():
    assert "core/seeds.py" not in names("coronaryuq.core.records")


def test_imports_are_those_that_the_whole_file_parsed_gives():
    files = sorted(PACKAGE.rglob("*.py"))
    assert len(files) > 200
    for path in files:
        assert set(provenance._imported(path)) == set(provenance._names(ast.parse(path.read_text()))), path


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("from coronaryuq.a import (  # why (not)\n    b,\n)\n", {"coronaryuq.a", "coronaryuq.a.b"}),
        ("def f():\n    import coronaryuq.a as x, coronaryuq.b\n", {"coronaryuq.a", "coronaryuq.b"}),
        ("from coronaryuq import a, \\\n    b\n", {"coronaryuq", "coronaryuq.a", "coronaryuq.b"}),
        ("from . import a\nimport numpy\n", set()),
    ],
)
def test_imports_written_in_other_ways(tmp_path, text, found):
    path = tmp_path / "module.py"
    path.write_text(text)
    assert set(provenance._imported(path)) == found


def test_digest_does_not_depend_on_key_order():
    assert provenance.digest({"a": 1, "b": [1, 2]}) == provenance.digest({"b": [1, 2], "a": 1})
    assert provenance.digest({"a": 1}) != provenance.digest({"a": 2})
