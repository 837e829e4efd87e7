"""Scores of the benchmark."""

import pytest

from coronaryuq.bench.discrepancy.tables import wilson


def test_wilson_interval_of_a_textbook_case():
    """9 of 10: 0.596 to 0.982 (Agresti & Coull 1998, formula 4)."""
    found = wilson(9, 10)
    assert (found["low"], found["high"]) == pytest.approx((0.5958, 0.9821), abs=2e-4)
