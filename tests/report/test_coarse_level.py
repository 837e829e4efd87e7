"""The sentence on the cost and the gain of a coarse level."""

from coronaryuq.estimation.results import CoarseLevel, LevelWorth
from coronaryuq.report.coarse_level import sentence
from support.estimates import row

ROWS = [
    row(row="osi_lad", label="max OSI, mean flow, LAD"),
    row(row="ffr_ffr_lad", label="FFR, FFR, LAD"),
    row(row="ffr_flow_lad", label="FFR, mean flow, LAD"),
]


def test_each_quantity_is_listed_once_with_its_smallest_gain():
    gains = {"osi_lad": 2.34, "ffr_ffr_lad": 0.71, "ffr_flow_lad": 1.9}
    worth = {name: LevelWorth("crossfit-GP", 0.5, gain, 4.0) for name, gain in gains.items()}
    text = sentence(ROWS, CoarseLevel(runs=96, failed=2, coarse_cpu_s=0.5312, fine_cpu_s=7.44, rows=worth))
    assert "96 runs of 0.53 CPU-s each, 2 of them failed; a fine run took 7.4 CPU-s" in text
    assert text.endswith(" for max OSI LAD (2.3), but not for FFR LAD (0.71).")


def test_without_a_coarse_level_the_sentence_is_empty():
    assert sentence(ROWS, None) == ""
