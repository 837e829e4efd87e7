"""What the comparison with other methods shows, in sentences whose numbers are those of the recorded cases."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.bench.discrepancy.rivals.compare import LEVEL, OURS, ahead, compared, group
from coronaryuq.bench.discrepancy.tables import right

ECHO = "outside:line_echo"
"""The case for which a form of something else was added after other methods had been compared."""
LEVELS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10, 1e-15, 1e-20, 1e-25, 1e-30)
"""Other levels of the test of what is left."""
SELECTION, REGRESSION = "forward selection by BIC", "sparse regression (SINDy)"
PROCESS, CLASSIFIER = "Gaussian process (Kennedy-O'Hagan)", "classifier (extremely randomised trees)"
TESTS = "exact tests with false-discovery control"
INSIDE, OUTSIDE, VIOLATED = "one effect", "outside the library", "nothing, priors violated"


def findings(rows: Sequence[dict], cases: Sequence[dict], recorded: Sequence[dict]) -> list[str]:
    """Return the list of what the comparison shows, in Markdown.

    Parameters
    ----------
    rows
        Entries of `side_by_side`, ours included.
    cases
        Entries of `rival_trial`, for the courses of the methods.
    recorded
        All cases, in whose proportions the lead is weighted.
    """
    table = compared(rows).set_index(["group", "method"])

    def count(name: str, method: str, column: str = "right") -> int:
        return int(table.loc[(name, method), column])

    def each(name: str, methods: Sequence[str], column: str = "right") -> str:
        return _listed([str(count(name, method, column)) for method in methods])

    every, plain = ahead(rows, recorded), ahead(rows)
    known = [[row for row in part if row["effect"] != ECHO] for part in (rows, recorded)]
    best = min(every, key=lambda entry: entry["difference"])
    rest, unweighted = (next(e for e in one if e["method"] == best["method"]) for one in (ahead(*known), plain))
    echoes = sum(row["effect"] == ECHO and row["method"] == OURS for row in rows)
    violated = [np.mean([case["noise"] == "violated" for case in part]) for part in (rows, recorded)]
    others = [PROCESS, CLASSIFIER]
    trails = {method: _by_level(cases, method) for method in (SELECTION, REGRESSION, TESTS)}
    at_level = _listed([str(found[LEVEL]) for found in trails.values()])
    pairs = sum(group(case) in (OUTSIDE, VIOLATED) for case in cases if not case.get("skipped"))
    best_level = _listed([str(max(found.values())) for found in trails.values()])
    ours = sum(count(name, OURS) for name in (OUTSIDE, VIOLATED))
    significant = "significant" if rest["low"] > 0.0 else "not significant"
    return [
        f"- **The lead.** In the proportions of all recorded cases of the open loop the search is right "
        f"{_points(best['difference'])} points more often than the best other method, {best['method']} (95 % interval "
        f"{_points(best['low'])} to {_points(best['high'])}); 20 points were wanted. Over the cases of this table, of "
        f"which {_points(violated[0])} % violate the priors ({_points(violated[1])} % of all), it is "
        f"{_points(unweighted['difference'])} points. {echoes} cases are the line echo, for which the unlisted "
        f"response of a device was added; without them the weighted lead is {_points(rest['difference'])} points "
        f"({_points(rest['low'])} to {_points(rest['high'])}), {significant}.",
        f"- **In the library** the search is right in {count(INSIDE, OURS)} of {count(INSIDE, OURS, 'cases')}, "
        f"selection and tests in {each(INSIDE, (SELECTION, TESTS))}, regression, process and classifier in "
        f"{each(INSIDE, (REGRESSION, *others))}.",
        f"- **Outside the library** the search is right in {count(OUTSIDE, OURS)} of {count(OUTSIDE, OURS, 'cases')}, "
        f"selection, regression and tests in {each(OUTSIDE, (SELECTION, REGRESSION, TESTS))}, process and classifier "
        f"in {each(OUTSIDE, others)}. Wrong names: {count(OUTSIDE, OURS, 'wrong name')} of the search, of these five "
        f"{each(OUTSIDE, (SELECTION, REGRESSION, TESTS, *others), 'wrong name')}.",
        f"- **Violated priors.** False alarms in {count(VIOLATED, OURS, 'cases')} cases: "
        f"{count(VIOLATED, OURS, 'false alarm')} of the search, "
        f"{each(VIOLATED, (SELECTION, REGRESSION, TESTS, *others), 'false alarm')} of selection, regression, tests, "
        f"process and classifier. Outside the library and under violated priors together, the search is right in "
        f"{ours} of {pairs} cases. Selection, regression and tests are right in {at_level} of {pairs} cases at the "
        f"level {LEVEL:g} of the test of what is left, or in {best_level} at the best of ten other levels from "
        f"{max(LEVELS):g} to {min(LEVELS):g}, chosen with the answers in view.",
    ]


def _points(share: float) -> str:
    return f"{100.0 * share:.0f}"


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1])] * (len(words) > 1) + list(words[-1:]))


def _by_level(cases: Sequence[dict], method: str) -> dict[float, int]:
    """Return level → right answers outside the library and under violated priors, where none may be named."""
    found = dict.fromkeys((LEVEL, *LEVELS), 0)
    for case in cases:
        if case.get("skipped") or group(case) not in (OUTSIDE, VIOLATED):
            continue
        trail = case["answers"][method]["trail"]
        for level in found:
            classes = next((classes for classes, p in trail if p >= level), None)
            answer = {"alarmed": classes != [], "named": False, "abstained": classes is None}
            found[level] += bool(not classes and right({**case, "placed": False, "classes": [], **answer}))
    return found
