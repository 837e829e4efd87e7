"""Rival: randomised trees on features of the residuals, trained on cases of the benchmark's generator."""

from collections.abc import Iterable

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier

from coronaryuq.bench.discrepancy.rivals.adapter import RivalAnswer, Seen
from coronaryuq.bench.discrepancy.rivals.training_cases import NONE, OTHER, Training, label
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.inference import gp_discrepancy
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.candidates import all_candidates

TREES = 500
TRIED = 0.2
"""Share of the features that are tried at each split: few of them tell nothing from something, so that with the usual
square root of their number hardly a split has one of these."""
PRIOR = {NONE: RULE.prior_none, OTHER: RULE.prior_outside}
"""Weights of the two groups of cases without a name; the rest is shared by the effects, as in the search."""


class Classifier:
    """Vote of trees for "nothing", "something else" or an effect at a place.

    The most probable of the three answers is given: nothing, something else, or the effect at a place with most votes,
    where all effects together have more than either. That effect is fitted in full beside its lookalikes. Source:
    Geurts, Ernst & Wehenkel, Machine Learning 63 (2006) 3. Of cases of eight subjects held back in turn, with four
    others to learn from, 80 of 80 with nothing hidden are answered so, and 193 of 394 effects are named right, with
    their places.
    """

    name = "classifier (extremely randomised trees)"

    def __init__(self, features: np.ndarray, labels: list[str]):
        self.trees = ExtraTreesClassifier(TREES, max_features=TRIED, random_state=0)
        self.trees.fit(features, labels, sample_weight=_weights(labels))

    @classmethod
    def trained(cls, batches: Iterable[list[Training]]) -> "Classifier":
        """Return the classifier that has learnt from cases, in batches that share a problem."""
        rows: list[np.ndarray] = []
        labels: list[str] = []
        for batch in batches:
            if batch:
                rows += map(Features(batch[0].problem), (case.fit for case in batch))
                labels += [case.label for case in batch]
        return cls(np.array(rows), labels)

    def votes(self, features: np.ndarray) -> dict[str, float]:
        """Return the share of the votes of every label for the features (f,) of a case."""
        shares = self.trees.predict_proba(features[None, :])[0]
        return dict(zip(map(str, self.trees.classes_), shares.tolist(), strict=True))

    def answer(self, seen: Seen) -> RivalAnswer:
        """Return the answer with the most votes."""
        votes = self.votes(Features(seen.problem)(seen.fit))
        first = decided(votes)
        if first in PRIOR:
            return RivalAnswer(alarmed=first == OTHER, probability=votes[first])
        (placed,) = (candidate.placed for candidate in seen.candidates if label(candidate.placed) == first)
        numbers = [i for i, candidate in enumerate(seen.linear.candidates) if candidate.placed == placed]
        found = seen.with_best(seen.linear.lookalikes(numbers[0])) if numbers else None
        members = (placed,) if found is None else found[1]
        return RivalAnswer((members,), True, sum(votes.get(label(one), 0.0) for one in members))


def decided(votes: dict[str, float]) -> str:
    """Return the label of the answer; that of an effect if all effects together have most votes."""
    named = {name: share for name, share in votes.items() if name not in PRIOR}
    first = max(PRIOR, key=lambda name: votes[name])
    return first if votes[first] >= sum(named.values()) else max(named, key=lambda name: named[name])


def _weights(labels: list[str]) -> np.ndarray:
    """Return weights by which each group of cases has its prior probability, effects shared equally, then places."""
    effects = [name.partition("@")[0] for name in labels]
    named = len({effect for effect in effects if effect not in PRIOR})
    places = {effect: {name for name in labels if name.partition("@")[0] == effect} for effect in set(effects)}
    return np.array(
        [
            PRIOR.get(effect, RULE.prior_named / named) / len(places[effect]) / labels.count(name)
            for name, effect in zip(labels, effects, strict=True)
        ]
    )


class Features:
    """Features of a recalibrated case that do not depend on when it was sampled.

    Score tests of all candidates by their responses about the prior mean; harmonics of the whitened residual of every
    series; both as directions, which hardly depend on the size of an effect, and with the logarithms of their lengths.
    """

    def __init__(self, problem: Problem):
        z = np.zeros(problem.count)
        rows = [(z, PLAIN)]
        for candidate in all_candidates(problem, PLAIN):
            size = 0.3 if not candidate.one_sided else -1.0
            rows.append((np.concatenate([z, candidate.at_size(size)]), PLAIN.with_(candidate.placed)))
        grafts = [placed for _, hypothesis in rows for placed in hypothesis if placed.effect.grafted]
        residuals = problem.fitted(rows, grafts)
        self.responses = np.nan_to_num(residuals[0] - residuals[1:]).T
        waves = gp_discrepancy.features(problem)[problem.train]
        norms = np.linalg.norm(waves, axis=0)
        self.waves = waves[:, norms > 0.0] / norms[norms > 0.0]

    def __call__(self, fit: Fit) -> np.ndarray:
        """Return the features of a fit of the plain model."""
        projected = np.einsum("ij,ij->j", self.responses, fit.projection(self.responses))
        scores = self.responses.T @ fit.score / np.sqrt(np.maximum(projected, RULE.visible_response**2))
        waves = self.waves.T @ fit.score
        parts = []
        for values in (scores, waves):
            length = float(np.linalg.norm(values))
            parts += [values / max(length, 1e-12), [np.log(max(length, 1e-12))], [np.log(np.abs(values).max())]]
        return np.concatenate([*parts, [np.log(fit.objective)]])
