"""Pair step: replace two effects by two others that explain the data better together.

Two effects may look like a third, as two stenoses of one artery look like a loss at the bifurcation between them.
Forward steps then begin with that one, and no exchange of one effect at a time leads away from it.
"""

from dataclasses import replace

import numpy as np

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import FARTHEST, Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.candidates import Candidate, Round, Rounds, replaced, round_of
from coronaryuq.discrepancy.selection.refit import drop
from coronaryuq.discrepancy.selection.score_test import first_size, nearest_runnable, screen

Pair = tuple[Candidate, Candidate]
LARGEST = 2.5
"""Size z up to which a response to a small size is extrapolated."""
SWEEPS = 20
"""Gauss-Newton steps of each size of a pair given the other."""


def pair_step(
    problem: Problem,
    hypothesis: Hypothesis,
    fit: Fit,
    rounds: Rounds,
    removed: tuple[PlacedEffect, PlacedEffect],
    candidates: list[Candidate],
) -> tuple[Hypothesis, Fit, Rounds]:
    """Replace two effects by the most probable pair of candidates, if it is more probable.

    Pairs are ranked by their linear responses about the fit without the effects removed; the first of those that
    promise to be more probable are fitted in full, but not pairs of members of the present classes.
    """
    others, point, old = hypothesis, fit, [round_of(rounds, placed) for placed in removed]
    for placed in removed:
        point, others = drop(point, others.columns(point.z, placed)), others.without(placed)
    prior = sum(entry.named.log_prior for entry in old)
    pool = [replace(c, fit=None, multistart=None) for c in candidates if c.placed not in others]
    scored = screen(problem, point, others, pool)
    classes = [{member.placed for member in entry.members} for entry in old]
    runnable = nearest_runnable(problem, point, others)
    pairs = _promising(runnable, scored, fit.evidence_without_error + prior, classes) if runnable else []
    hypotheses = [others.with_(first.placed).with_(second.placed) for first, second in pairs]
    starts = [np.concatenate([point.z, first.start, second.start]) for first, second in pairs]
    fits = problem.calibrate_each(list(zip(hypotheses, starts, strict=True)))
    best, weight = None, fit.evidence + prior
    for pair, both, other in zip(pairs, hypotheses, fits, strict=True):
        if other is not None and other.evidence + sum(c.log_prior for c in pair) > weight:
            best, weight = (pair, both, other), other.evidence + sum(c.log_prior for c in pair)
    if best is None:
        return hypothesis, fit, rounds
    pair, both, found = best
    for entry, candidate in zip(old, pair, strict=True):
        named = replace(candidate, fit=found)
        decided = Round([], None, scored=scored).decided(named, [named], both.without(candidate.placed))
        rounds = replaced(rounds, entry, decided)
    return both, found, rounds


def _promising(point: Fit, scored: list[Candidate], least: float, classes: list[set[PlacedEffect]]) -> list[Pair]:
    """Return the pairs of largest log weight by their responses about a point, if it exceeds `least`, with guesses.

    classes: of which pairs with one member each are left out.
    """
    seen = [c for c in scored if c.effect.nameable and c.response is not None and np.isfinite(c.response).all()]
    responses = np.reshape([c.response for c in seen], (len(seen), len(point.residual)))
    inner = responses @ point.projection(responses.T)
    visible = np.flatnonzero(np.diag(inner) > RULE.visible_response**2)
    seen, inner = [seen[k] for k in visible], inner[np.ix_(visible, visible)]
    pairs = np.array(np.triu_indices(len(seen), 1))
    along, squares, cross = (responses[visible] @ point.score)[pairs], np.diag(inner)[pairs], inner[tuple(pairs)]
    # Multiples of the responses to first sizes, for sizes z, and their slopes; positive ones grow exponentially with z.
    first = np.array([first_size(c) for c in seen])[pairs]
    spread = np.array([c.effect.parameters[0].spread if c.one_sided else 0.0 for c in seen])[pairs]

    def multiples(sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        by = np.where(spread > 0.0, np.exp(spread * (sizes - first)), sizes / first)
        return by, np.where(spread > 0.0, spread * by, 1.0 / first)

    sizes = np.zeros(pairs.shape)
    for own in (0, 1) * SWEEPS:
        by, slopes = multiples(sizes)
        left = along[own] - cross * by[1 - own] - squares[own] * by[own]
        step = (slopes[own] * left - sizes[own]) / (1.0 + slopes[own] ** 2 * squares[own])
        sizes[own] = np.clip(sizes[own] + np.clip(step, -FARTHEST, FARTHEST), -LARGEST, LARGEST)
    by, slopes = multiples(sizes)
    gains = np.sum(by * along - 0.5 * by**2 * squares - 0.5 * sizes**2, axis=0) - by.prod(axis=0) * cross
    widths = np.prod(1.0 + slopes**2 * squares, axis=0) - (slopes.prod(axis=0) * cross) ** 2
    without = -0.5 * float(point.at_zero @ point.score + np.linalg.slogdet(point.precision)[1])
    priors = np.array([c.log_prior for c in seen])[pairs].sum(axis=0)
    weights = without + gains - 0.5 * np.log(widths) + priors
    inside = np.array([[c.placed in members for c in seen] for members in classes], dtype=bool)[:, pairs]
    weights[inside[0, 0] & inside[1, 1] | inside[0, 1] & inside[1, 0]] = -np.inf
    best = [k for k in np.argsort(-weights)[: RULE.rivals] if weights[k] > least]
    return [
        (replace(seen[i], guess=float(sizes[0, k])), replace(seen[j], guess=float(sizes[1, k])))
        for k, (i, j) in zip(best, pairs[:, best].T, strict=True)
    ]
