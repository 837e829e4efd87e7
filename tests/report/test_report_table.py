"""Warnings below the table stand once."""

from coronaryuq.report.table import Notes


def test_a_warning_stands_once_and_is_named_by_number():
    notes = Notes()
    assert notes.numbers(["a", "b"]) == "[1] [2]"
    assert notes.numbers(["b", "c"]) == "[2] [3]"
    assert notes.texts == ["a", "b", "c"]
