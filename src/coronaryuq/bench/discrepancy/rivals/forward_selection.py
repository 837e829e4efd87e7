"""Rival: forward selection by the extended Bayesian information criterion, with Gauss-Newton refits."""

from math import comb, log

from coronaryuq.bench.discrepancy.rivals.adapter import MOST_NAMES, RivalAnswer, Seen, first_sufficient
from coronaryuq.discrepancy.selection.candidates import shortlist


class ForwardSelection:
    """Add the effect that lowers the criterion most, as long as one does; then test what is left.

    EBIC = BIC + 2 log C(n, m) for m effects of n candidates (Chen & Chen, Biometrika 95 (2008) 759, with gamma = 1):
    plain BIC (Schwarz 1978) supposes few candidates. Fits are those of our search, without its held-out test and its
    flexible discrepancy. What is left is tested at the level `left_over`.
    """

    name = "forward selection by BIC"

    def __init__(self, left_over: float):
        self.left_over = left_over

    def answer(self, seen: Seen) -> RivalAnswer:
        """Return the effects selected."""
        present, classes = seen, []
        while len(present.hypothesis) < MOST_NAMES:
            found = present.with_best(shortlist(present.candidates, seen.problem.settings.shortlist))
            if found is None or _extended(found[0], seen) >= _extended(present, seen):
                break
            present, members = found
            classes.append(members)
        return first_sufficient(((tuple(classes), present.misfit),), self.left_over)


def _extended(present: Seen, first: Seen) -> float:
    return present.criterion + 2.0 * log(comb(len(first.candidates), len(present.hypothesis)))
