"""Rivals on cases of the benchmark, and their answers beside ours."""

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import BenchmarkExperiment
from coronaryuq.bench.discrepancy.reliability import kind
from coronaryuq.bench.discrepancy.rivals.adapter import Class, Rival, look
from coronaryuq.bench.discrepancy.rivals.classifier import Classifier
from coronaryuq.bench.discrepancy.rivals.forward_selection import ForwardSelection
from coronaryuq.bench.discrepancy.rivals.gaussian_process import GaussianProcess
from coronaryuq.bench.discrepancy.rivals.score_tests import ScoreTests
from coronaryuq.bench.discrepancy.rivals.sparse_regression import SparseRegression
from coronaryuq.bench.discrepancy.rivals.training_cases import training_cases
from coronaryuq.bench.discrepancy.score import matches
from coronaryuq.bench.discrepancy.tables import names_something, right, wilson
from coronaryuq.bench.discrepancy.trial import hide
from coronaryuq.discrepancy.hidden.nature import Nature

OURS = "this search"
LEVEL = 0.01
"""Level of the test of what is left, and of the Gaussian process: that of our search's global test."""
SUBJECTS = 20
"""Draws of the truth from which the classifier learns; each gives about a hundred cases."""
EVERY = "all cases"
KEPT = ("named", "placed", "first", "alarmed", "abstained", "classes", "probability", "cpu_s")


def every_rival(experiment: BenchmarkExperiment, nature: Nature, subjects: int = SUBJECTS) -> list[Rival]:
    """Return all rivals, the classifier trained on that many subjects."""
    with threadpool_limits(1):
        trained = Classifier.trained(training_cases(experiment, nature, subjects))
    return [ForwardSelection(LEVEL), SparseRegression(LEVEL), GaussianProcess(LEVEL), trained, ScoreTests(LEVEL)]


def rival_trial(
    case: Case, experiment: BenchmarkExperiment, nature: Nature, rivals: Sequence[Rival], threads: int = 1
) -> dict | None:
    """Make one case and let every rival answer; None if the effect has no place.

    Returns
    -------
    dict
        The cell, and `answers`: name of the rival → its scored answer. cpu_s: of reading, recalibrating and screening,
        and of the rival itself.
    """
    with tempfile.TemporaryDirectory() as name, threadpool_limits(1):
        folder = Path(name)
        truth, redrawn = hide(case, experiment, folder, nature)
        entry: dict[str, Any] = {
            "effect": case.label,
            "strength": case.strength,
            "noise": case.noise,
            "seed": case.seed,
        }
        if truth is None:
            return {**entry, "skipped": True, "redrawn": redrawn} if redrawn else None
        begin = time.process_time()
        seen = look(folder, threads)
        _ = seen.linear  # screens
        shared = time.process_time() - begin
        answers = {}
        for rival in rivals:
            begin = time.process_time()
            answer = rival.answer(seen)
            spent = shared + time.process_time() - begin
            scored = matches(truth.hypothesis, _keys(answer.classes), answer.alarmed)
            trail = [[[["@".join(key) for key in members] for members in _keys(c)], p] for c, p in answer.trail]
            answers[rival.name] = scored | {"probability": answer.probability, "cpu_s": spent, "trail": trail}
        return {**entry, "places": [p for _, p in truth.hypothesis], "visible": truth.visible, "answers": answers}


def _keys(classes: tuple[Class, ...]) -> list[list[tuple[str, str]]]:
    return [[placed.key for placed in members] for members in classes]


def side_by_side(cases: Sequence[dict], ours: Sequence[dict] = ()) -> list[dict]:
    """Return an entry per method and case; with `ours`, only of the cases that both have.

    Parameters
    ----------
    cases
        Entries of `rival_trial`.
    ours
        Entries of our search.
    """
    cell = ("network", "effect", "strength", "noise", "seed")
    known = {tuple(case.get(name) for name in cell): case for case in ours if not case.get("skipped")}
    rows = []
    for case in cases:
        key = tuple(case.get(name) for name in cell)
        if case.get("skipped") or ours and key not in known:
            continue
        answers = ({OURS: known[key]} if ours else {}) | case["answers"]
        rows += [
            dict(zip(cell, key, strict=True)) | {"method": method} | {name: answer.get(name) for name in KEPT}
            for method, answer in answers.items()
        ]
    return rows


def outcome(case: dict) -> str:
    """Return "right", "false alarm" (nothing hidden), "wrong name", or "missed": "something else" or "nothing"."""
    if right(case):
        return "right"
    if case["effect"] == "none":
        return "false alarm"
    return "wrong name" if names_something(case) else "missed"


def group(case: dict) -> str:
    """Return the kind of truth of a case, and whether it violates the priors."""
    return kind(case) + (", priors violated" if case["noise"] == "violated" else "")


def compared(rows: Sequence[dict]) -> pd.DataFrame:
    """Count the outcomes of every method by group and over all cases.

    Parameters
    ----------
    rows
        Entries of `side_by_side`.

    Returns
    -------
    DataFrame
        group, method, cases, right with its share and 95 % Wilson interval (low, high), alone (right, and nothing else
        named), wrong name, missed, false alarm, cpu_s (mean).
    """
    table = []
    groups = sorted({group(row) for row in rows}, key=lambda name: ("nothing" in name, "outside" in name, name))
    for name in (*groups, EVERY):
        for method in dict.fromkeys(row["method"] for row in rows):
            mine = [row for row in rows if row["method"] == method and name in (group(row), EVERY)]
            outcomes = [outcome(row) for row in mine]
            alone = sum(one == "right" and len(row["classes"]) <= 1 for one, row in zip(outcomes, mine, strict=True))
            counts = {one: outcomes.count(one) for one in ("right", "wrong name", "missed", "false alarm")}
            interval = wilson(counts["right"], len(mine))
            entry = {"group": name, "method": method, "cases": interval.pop("trials"), **counts, "alone": alone}
            table.append(entry | interval | {"cpu_s": float(np.mean([row["cpu_s"] for row in mine]))})
    return pd.DataFrame(table)


def outcomes(cases: Sequence[dict]) -> list[dict]:
    """Return the rows of `compared` for rivals alone, for the results in JSON."""
    return compared(side_by_side(cases)).to_dict("records") if cases else []


def ahead(rows: Sequence[dict], every: Sequence[dict] = ()) -> list[dict]:
    """Return by how much the share of right answers of our search exceeds each rival's.

    Parameters
    ----------
    rows
        Entries of `side_by_side`, ours included.
    every
        Cases in whose proportions of groups the differences are weighted; without them, all rows count the same.

    Returns
    -------
    list of dict
        method, difference, only_ours and only_theirs (cases that only one has right), and low and high: 95 % interval
        of the difference of paired shares (Agresti & Min, Statist. Med. 24 (2005) 729: half a pair added to each of the
        four outcomes; here of each group, see Cochran, Sampling Techniques, 3rd ed. (1977), ch. 5, if weighted).
    """
    by_method: dict[str, list[dict]] = {}
    for row in rows:
        by_method.setdefault(row["method"], []).append(row)
    ours = by_method.pop(OURS)
    groups = np.array([group(row) if every else EVERY for row in ours])
    shares = {name: sum(group(case) == name for case in every) for name in np.unique(groups)} if every else {EVERY: 1}
    total, correct, found = sum(shares.values()), np.array([right(row) for row in ours]), []
    for method, others in by_method.items():
        theirs = np.array([right(row) for row in others])
        difference = centre = variance = 0.0
        for name, share in shares.items():
            mine, weight = groups == name, share / total
            counts = [int((mine & correct & ~theirs).sum()), int((mine & ~correct & theirs).sum())]
            first, second = (np.array(counts) + 0.5) / (mine.sum() + 2.0)
            difference += weight * (counts[0] - counts[1]) / mine.sum()
            centre += weight * (first - second)
            variance += weight**2 * (first + second - (first - second) ** 2) / (mine.sum() + 2.0)
        error = 1.96 * np.sqrt(variance)
        bounds = {"low": float(centre - error), "high": float(centre + error)}
        alone = int((correct & ~theirs).sum()), int((~correct & theirs).sum())
        found.append(
            {"method": method, "difference": float(difference), **bounds}
            | dict(zip(("only_ours", "only_theirs"), alone, strict=True))
        )
    return found
