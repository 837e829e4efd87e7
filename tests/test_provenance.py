"""A result's sources are all the files it could depend on, and no others."""

from pathlib import Path

from coronaryuq import provenance


def names(*modules):
    root = Path(provenance.__file__).parent
    return {path.relative_to(root).as_posix() for path in provenance.sources(*modules)}


def test_sources_follow_imports_to_the_ground():
    found = names("coronaryuq.records")
    assert {"__init__.py", "records.py", "errors.py", "files.py"} <= found


def test_sources_leave_out_what_is_not_imported():
    assert "seeds.py" not in names("coronaryuq.records")


def test_digest_does_not_depend_on_key_order():
    assert provenance.digest({"a": 1, "b": [1, 2]}) == provenance.digest({"b": [1, 2], "a": 1})
    assert provenance.digest({"a": 1}) != provenance.digest({"a": 2})
