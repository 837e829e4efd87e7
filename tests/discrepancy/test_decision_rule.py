"""The thresholds of the search are in one table, which the documentation holds."""

from dataclasses import fields
from pathlib import Path

from coronaryuq.discrepancy.decision_rule import RULE, table

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "discrepancy-method.md"


def test_the_documentation_holds_the_table_of_thresholds():
    assert table() in PAGE.read_text(encoding="utf-8"), "paste coronaryuq.discrepancy.decision_rule.table() there"


def test_every_threshold_has_a_unit_and_a_description_of_one_sentence():
    for entry in fields(RULE):
        assert entry.metadata["unit"] and entry.metadata["description"].endswith("."), entry.name
