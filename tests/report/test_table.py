"""Warnings below the table are listed once."""

from coronaryuq.report.table import Notes


def test_a_warning_is_listed_once_and_cited_by_number():
    notes = Notes()
    assert notes.numbers(["a", "b"]) == "[1] [2]"
    assert notes.numbers(["b", "c"]) == "[2] [3]"
    assert notes.texts == ["a", "b", "c"]
