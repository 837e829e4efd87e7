"""One sentence says what a coarse level cost and where it paid."""

from coronaryuq.report.coarse_level import sentence

ROWS = [
    {"row": "osi_lad", "label": "max OSI, mean flow, LAD"},
    {"row": "ffr_ffr_lad", "label": "FFR, FFR, LAD"},
    {"row": "ffr_flow_lad", "label": "FFR, mean flow, LAD"},
]
COARSE = {"runs": 96, "failed": 2, "coarse_cpu_s": 0.5312, "fine_cpu_s": 7.44}


def test_each_quantity_stands_once_with_the_lesser_gain():
    gains = {"osi_lad": {"gain": 2.34}, "ffr_ffr_lad": {"gain": 0.71}, "ffr_flow_lad": {"gain": 1.9}}
    said = sentence({"rows": ROWS, "coarse": COARSE | {"rows": gains}})
    assert "96 runs at 0.53 CPU-s, 2 of them failed; a fine run took 7.4 CPU-s" in said
    assert said.endswith("it paid for max OSI LAD (2.3) and did not for FFR LAD (0.71).")


def test_without_a_coarse_level_nothing_is_said():
    assert sentence({"rows": ROWS, "coarse": None}) == sentence({"rows": ROWS}) == ""
