"""Fits that ended behind no effect at all are made again; candidates are looked at from a distorted fit, too."""

from types import SimpleNamespace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.selection.candidates import ASTRAY, ASTRAY_TRIED, Candidate, fit_shortlist, lost
from coronaryuq.discrepancy.selection.forward_step import name_one
from coronaryuq.discrepancy.settings import Settings
from support.hypotheses import assume
from support.linear_problem import LinearProblem, here

ROWS, NUISANCES, PRIOR = 120, 2, -3.0


class Astray(LinearProblem):
    """Of two effects the first is what was hidden, but its fit from its own guess ends far away."""

    def __init__(self):
        random = generator(9, "test", "astray")
        self.nuisance = random.standard_normal((ROWS, NUISANCES))
        self.acting = [here("right"), here("wrong")]
        right, own = random.standard_normal((2, ROWS))
        self.along = dict(zip(self.acting, (right, 0.4 * right + own), strict=True))
        self.y = 2.0 * right + random.standard_normal(ROWS)
        self.forward, self.settings = SimpleNamespace(nuisances=[None] * NUISANCES), Settings()
        self.condition, self.train = np.full(ROWS, "rest"), np.ones(ROWS, bool)

    def far(self, acting):
        if self.acting[0] not in acting:
            return self.calibrate(acting)
        g = self.columns(acting)
        z = np.append(np.zeros(g.shape[1] - 1), -4.0)
        return Fit(z, self.y - g @ z, g)

    def fit_candidates(self, base, acting, candidates, guesses):
        return [self.far(acting.with_(one)) for one in candidates]

    def calibrate_each(self, wanted):
        return [self.far(acting) for acting, _ in wanted]

    def from_the_mean(self, acting):
        return self.calibrate(acting)


def test_a_fit_behind_no_effect_at_all_has_gone_astray():
    problem = Astray()
    base = problem.calibrate(assume())
    fits = [problem.far(assume(problem.acting[0])), base, None]
    right, kept, unfit = (Candidate(*here(str(i)), PRIOR, estimate=1e3, fit=fit) for i, fit in enumerate(fits))
    assert right.fit.evidence < base.evidence - ASTRAY
    assert lost([right, kept, unfit], 0.0, base.evidence) == [right]
    assert lost([right], 1e6, base.evidence) == [], "what does not promise to compete is left"


def test_of_those_astray_the_best_place_of_the_most_promising_effects_is_tried_again():
    problem = Astray()
    base, far = problem.calibrate(assume()), problem.far(assume(problem.acting[0]))
    effects = [here(str(number))[0] for number in range(ASTRAY_TRIED + 3)]
    astray = [
        Candidate(effect, place, PRIOR, estimate=1e3 + 10.0 * number + better, fit=far)
        for number, effect in enumerate(effects)
        for place, better in (("there", 0.0), ("here", 1.0))
    ]
    found = lost(astray, 0.0, base.evidence)
    assert [c.place for c in found] == ["here"] * ASTRAY_TRIED
    assert [c.effect for c in found] == effects[: -ASTRAY_TRIED - 1 : -1]


def test_the_right_effect_is_named_although_its_first_fit_went_astray():
    problem = Astray()
    base = problem.calibrate(assume())
    chosen = [Candidate(*one, PRIOR, estimate=base.evidence + 100.0, guess=np.ones(1)) for one in problem.acting]
    fit_shortlist(problem, base, assume(), chosen, base)
    exact = problem.calibrate(assume(problem.acting[0]))
    assert chosen[0].fit.evidence == pytest.approx(exact.evidence)
    assert chosen[0].log_weight > chosen[1].log_weight


class Distorted(LinearProblem):
    """From the prior's mean, beside an effect that is named, what is missing looks like nothing."""

    def __init__(self):
        random = generator(10, "test", "astray")
        self.nuisance = random.standard_normal((ROWS, NUISANCES))
        self.named, self.right = here("named"), here("right")
        self.along = {self.named: random.standard_normal(ROWS), self.right: random.standard_normal(ROWS)}
        self.y = 2.0 * self.along[self.right] + 40.0 * self.nuisance[:, 0] + random.standard_normal(ROWS)
        self.forward, self.settings = SimpleNamespace(nuisances=[None] * NUISANCES), Settings()
        self.condition, self.train = np.full(ROWS, "rest"), np.ones(ROWS, bool)


def test_what_nothing_shows_of_from_the_priors_mean_is_seen_from_the_fit():
    problem = Distorted()
    fit = problem.calibrate(assume(problem.named))
    for vantage, seen in ((fit, False), (Fit(np.zeros(3), problem.y, fit.jacobian), True)):
        unseen = Candidate(*problem.right, PRIOR, guess=np.ones(1))
        found = name_one(problem, fit, assume(problem.named), np.zeros((ROWS, 1)), [unseen], vantage)
        assert (found.accepted is unseen) is seen
