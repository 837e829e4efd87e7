"""Is Laplace's approximation good enough? The answers of a search with evidence by importance sampling in its place."""

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import logsumexp
from threadpoolctl import threadpool_limits

from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import BenchmarkExperiment
from coronaryuq.bench.discrepancy.sampled_evidence import Sampled, sampled_evidence
from coronaryuq.bench.discrepancy.trial import analyse, hide
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.hidden.nature import Nature
from coronaryuq.discrepancy.inference.cross_validation import posterior_of_all
from coronaryuq.discrepancy.inference.flexible import RIGHT, UNKNOWN
from coronaryuq.discrepancy.selection.answer import ALONE, NAMES, NOTHING, OTHER, REMAINDER
from coronaryuq.discrepancy.selection.discovery import Discovery

PRIORS = {"right": RIGHT, "unknown": UNKNOWN}
RELIABLE = 0.7
"""Pareto k above which an integral cannot be relied on."""


def evidence_trial(case: Case, experiment: BenchmarkExperiment, nature: Nature, threads: int = 1) -> dict | None:
    """Make and search one case, and compute the evidence behind its answer again; None if the effect has no place."""
    with tempfile.TemporaryDirectory() as name, threadpool_limits(1):
        folder = Path(name)
        truth, _ = hide(case, experiment, folder, nature)
        if truth is None:
            return None
        discovery = analyse(folder, threads)
        begin = time.process_time()
        found = compared(discovery, case.seed)
        cost = time.process_time() - begin
    return {"effect": case.label, "seed": case.seed, **found, "cpu_s": cost}


def compared(discovery: Discovery, seed: int) -> dict[str, Any]:
    """Return evidence by Laplace and by sampling of both models of an answer, and the answer's probabilities by both.

    Returns
    -------
    dict
        `evidence`: one entry per model (`plain`, and `found` where effects were found) and prior of the amplitude, with
        `laplace`, `sampled`, its `error`, `k_hat`. `probabilities`, `sampled_probabilities`: of the answers; the other
        forms of something else keep their ratio to the model that they vary.
    """
    models = {"plain": (discovery.base_problem, discovery.base, Hypothesis())}
    if discovery.hypothesis:
        models["found"] = (discovery.problem, discovery.fit, discovery.hypothesis)
    rows, change = [], {}
    for model, (problem, fit, hypothesis) in models.items():
        posterior = posterior_of_all(problem, fit, hypothesis)
        for name, prior in PRIORS.items():
            random = generator(seed, "discrepancy", "evidence", model, name)
            sampled = sampled_evidence(problem, fit, hypothesis, prior, random)
            laplace = float(logsumexp(posterior.log_evidence + prior))
            change[model, name] = sampled.log_evidence - laplace
            rows.append({"model": model, "prior": name, "laplace": laplace, **_entry(sampled)})
    return {
        "evidence": rows,
        "probabilities": dict(discovery.answer.probabilities),
        "sampled_probabilities": _reweighted(discovery, change),
    }


def _entry(sampled: Sampled) -> dict[str, float]:
    return {"sampled": sampled.log_evidence, "error": sampled.error, "k_hat": sampled.k_hat}


def _reweighted(discovery: Discovery, change: dict[tuple[str, str], float]) -> dict[str, float]:
    """Return the probabilities of the answers with the log evidence of their models changed."""
    answer = discovery.answer
    with np.errstate(divide="ignore"):
        logs = {name: float(np.log(value)) for name, value in answer.probabilities.items() if name != OTHER}
        forms = {name: float(np.log(value)) for name, value in answer.forms.items()}
    right = change.get(("found", "right"), change["plain", "right"])
    logs[NOTHING] += change["plain", "right"]
    logs[NAMES] += right
    changes = {ALONE: change["plain", "unknown"], REMAINDER: change.get(("found", "unknown"), 0.0)}
    logs[OTHER] = float(logsumexp([value + changes.get(form, right) for form, value in forms.items()]))
    total = logsumexp(list(logs.values()))
    return {name: float(np.exp(value - total)) for name, value in logs.items()}


def summary(entries: list[dict]) -> dict[str, Any]:
    """Return how far the two differ over all cases.

    Returns
    -------
    dict
        `cases`; `reliable`: integrals with a Pareto k below `RELIABLE`, of `integrals`; `nats`: root mean square and
        largest difference of their log evidence in the model that each answer is about (`found`, or `plain` where
        nothing was found); `largest_change`: of the probability of an answer; `changed`: cases whose likeliest answer
        differs.
    """
    rows = [(row, _about(entry)) for entry in entries for row in entry["evidence"]]
    reliable = [row for row, _ in rows if row["k_hat"] < RELIABLE]
    own = [row["sampled"] - row["laplace"] for row, about in rows if row["model"] == about and row["k_hat"] < RELIABLE]
    pairs = [(entry["probabilities"], entry["sampled_probabilities"]) for entry in entries]
    return {
        "cases": len(entries),
        "integrals": len(rows),
        "reliable": len(reliable),
        "nats": {"rms": float(np.sqrt(np.mean(np.square(own)))), "largest": max(own, key=abs)} if own else None,
        "largest_change": max((abs(a[name] - b[name]) for a, b in pairs for name in a), default=0.0),
        "changed": sum(max(a, key=lambda n: a[n]) != max(b, key=lambda n: b[n]) for a, b in pairs),
    }


def _about(entry: dict) -> str:
    return entry["evidence"][-1]["model"]
