"""Rival: exact tests of every candidate with control of false discoveries, one discovery after the other."""

import numpy as np
from scipy import stats

from coronaryuq.bench.discrepancy.rivals.adapter import MOST_NAMES, RivalAnswer, Seen, first_sufficient

LEVEL = 0.05
"""False discovery rate."""


class ScoreTests:
    """Name the most significant discovery, refit with it, and test the others again; then test what is left.

    Under the recalibrated model, linear and with known noise, a candidate's score is normal exactly (Rao 1948).
    Discoveries: Benjamini & Hochberg, J. R. Stat. Soc. B 57 (1995) 289. As in LISDD (arXiv 2606.23215), which tests
    terms missing from a model exactly and with control of false discoveries. Each discovery is fitted in full beside
    its lookalikes. What is left after the last is tested at the level `left_over`.
    """

    name = "exact tests with false-discovery control"

    def __init__(self, left_over: float):
        self.left_over = left_over

    def answer(self, seen: Seen) -> RivalAnswer:
        """Return the discoveries."""
        present, classes = seen, []
        while len(present.hypothesis) < MOST_NAMES:
            p_values = [candidate.p_value for candidate in present.candidates]
            if stats.false_discovery_control(p_values).min() >= LEVEL:
                break
            best = int(np.argmax([candidate.z_score for candidate in present.linear.candidates]))
            found = present.with_best(present.linear.lookalikes(best))
            if found is None:
                break
            present, members = found
            classes.append(members)
        return first_sufficient(((tuple(classes), present.misfit),), self.left_over)
