"""A candidate whose fit has far to go is not given up for one that looks better on the way."""

from types import SimpleNamespace

import numpy as np
from linear_problem import LinearProblem

from coronaryuq.discrepancy.inference import FARTHEST
from coronaryuq.discrepancy.problem import FAR_BEHIND
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.seeds import generator
from coronaryuq.zerod.effects.base import Parameter

ROWS, FAR = 80, 30.0
SIZE = Parameter("size", "1", "normal", 0.0, 1.0, "")


class FarToGo(LinearProblem):
    """The hidden effect stands beside a nuisance parameter far from its prior, which the wrong effect acts along."""

    def __init__(self):
        random = generator(1, "test", "far to go")
        own, along = random.standard_normal((2, ROWS))
        self.nuisance = along[:, None]
        self.right, self.wrong = (
            (type("MadeUp", (), {"name": name, "parameters": (SIZE,), "grafted": False})(), "here")
            for name in ("right", "wrong")
        )
        self.along = {self.right: 5.0 * own, self.wrong: along}
        self.y = FAR * along + 10.0 * own + random.standard_normal(ROWS)
        self.forward, self.settings = SimpleNamespace(nuisances=[None]), Settings(starts=1)


def test_the_right_effect_is_fitted_to_the_end():
    problem = FarToGo()
    start = problem.calibrate([])
    start.z, start.residual = np.zeros(1), problem.y
    right, wrong = problem.fit_candidates(start, [], [problem.right, problem.wrong], [np.zeros(1), np.zeros(1)])
    exact = problem.calibrate([problem.right])
    assert right.evidence > exact.evidence - 0.1
    assert right.evidence > wrong.evidence + FAR_BEHIND


def test_after_two_steps_the_wrong_one_is_far_ahead():
    """So the case above tests what it says: two steps take the wrong one twice as far."""
    problem = FarToGo()
    far = 2.0 * FARTHEST
    ahead = [problem.y - far * problem.nuisance[:, 0] - more for more in (2.0 * problem.along[problem.right], 0.0)]
    ahead[1] = ahead[1] - far * problem.along[problem.wrong]
    assert 0.5 * (ahead[0] @ ahead[0] - ahead[1] @ ahead[1]) > FAR_BEHIND
