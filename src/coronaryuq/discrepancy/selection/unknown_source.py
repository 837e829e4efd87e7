"""Where something else is missing: an unknown source of flow at each node, its waveform, and a law that it may follow.

About the fit the measurements respond linearly to the weights of a source's waveform, half of which it has in common in
all conditions and half in each by itself. So the evidence of a source at a node, the waveform there and the evidence of
a law for it, q = g P, q = C dP/dt or q = g Q with P and Q at that node, have closed forms; of a law the waveform under
every condition is known up to one size.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp, softmax

from coronaryuq.core.mixture import mixture_moments
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.inference.cross_validation import linearise, of_all
from coronaryuq.discrepancy.inference.flexible import Posterior
from coronaryuq.discrepancy.inference.gauss_newton import Linear
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.unlisted_response import Response, shares_of_responses
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.flow_source import FlowSource, basis

SCALES = (0.03, 0.1, 0.3, 1.0)
"""Standard deviations of a source's mean over the mean flow of its vessel, equally likely."""
POINTS = 120
"""Phases at which waveforms are evaluated."""
SOURCE = FlowSource()
FREE = "free waveform"
LAWS = {
    "leak": "in proportion to pressure, as through a resistance",
    "storage": "in proportion to the rate of change of pressure, as into a compliance",
    "share of the flow": "in proportion to the flow, as an error of its measurement or of a bed's share",
    "constant": "constant",
}
"""Laws of a source, and what they say of it."""


@dataclass(frozen=True)
class UnknownSource:
    """A source of flow at one node; positive: blood leaves there.

    Attributes
    ----------
    place
        The vessel at whose end it is.
    waveforms
        Condition → mean (`POINTS`,) and standard deviation of the flow at even phases of the beat, mL/s.
    laws
        Law, or `FREE` → probability; they add up to 1.
    sizes
        Law → size and its standard deviation: of the source's mean magnitude, over the mean flow of the vessel.
    """

    place: str
    waveforms: dict[str, tuple[np.ndarray, np.ndarray]]
    laws: dict[str, float]
    sizes: dict[str, tuple[float, float]]

    @property
    def law(self) -> str:
        """The most probable law, or `FREE`."""
        return max(self.laws, key=lambda name: self.laws[name])


def source_changes(problem: Problem, z: np.ndarray, hypothesis: Hypothesis) -> dict[str, np.ndarray]:
    """Return how a source at each node of an open loop changes the predictions of a model.

    Parameters
    ----------
    problem, z, hypothesis
        Measurements, and a fit (p,) of a hypothesis.

    Returns
    -------
    dict
        Vessel → change (N, k) of all predictions, CGS, by each shape of one prior standard deviation of a source at its
        end; without vessels with whose source the model does not run.
    """
    places = SOURCE.places(problem.forward.anatomy, problem.forward.measured)
    silent = np.concatenate([z, np.zeros(len(SOURCE.parameters))])
    units = np.eye(len(silent))[len(z) :]
    found = {}
    for place in places:
        with_source = hypothesis.with_(PlacedEffect(SOURCE, place))
        residual, *moved = problem.whitened([(row, with_source) for row in [silent, *(silent + units)]])
        found[place] = (residual - np.array(moved)).T * problem.sd[:, None]
    return {place: change for place, change in found.items() if np.isfinite(change).all()}


def possible_sources(
    problem: Problem, changes: Mapping[str, np.ndarray], possible: Sequence[Effect]
) -> Iterator[Response]:
    """Yield the source at each node, for each scale; see `source_changes` and `unlisted_responses`."""
    *_, share = shares_of_responses(possible)
    for place, change in changes.items() if share else ():
        columns = _columns(problem, change / problem.sd[:, None])
        prior = float(np.log(RULE.prior_outside * share / len(changes) / len(SCALES)))
        yield from (Response("", place, np.arange(len(columns)), scale * columns, prior) for scale in SCALES)


def unknown_source(
    problem: Problem, z: np.ndarray, hypothesis: Hypothesis, changes: Mapping[str, np.ndarray]
) -> tuple[list[tuple[str, float]], UnknownSource | None]:
    """Seek an unknown source of flow at every node of an open loop.

    Parameters
    ----------
    problem, z, hypothesis
        Measurements, and a fit (p,) of a hypothesis.
    changes
        `source_changes` of that fit.

    Returns
    -------
    nodes
        Vessel and the nats that a source at its end adds to the log evidence, the largest first.
    source
        That of the first; None if there is no node, or if none adds anything.
    """
    if not changes:
        return [], None
    model = linearise(problem, z, hypothesis)
    without = of_all(problem, model).right
    found = []
    for place, change in changes.items():
        responses = change / problem.sd[:, None]
        columns = _columns(problem, responses)
        alternatives = [of_all(problem, model.extended(scale * columns)) for scale in SCALES]
        found.append((place, responses, alternatives))
    found.sort(key=lambda one: -_averaged(one[2]))
    nodes = [(place, _averaged(alternatives) - without) for place, _, alternatives in found]
    if nodes[0][1] <= 0.0:
        return nodes, None
    return nodes, _described(problem, model, hypothesis, *found[0])


def _described(
    problem: Problem, model: Linear, hypothesis: Hypothesis, place: str, responses: np.ndarray, free: list[Posterior]
) -> UnknownSource:  # fmt: skip
    """Return waveform and laws of the source at one place; free: posteriors with any waveform, by scale."""
    evidences, sizes = {FREE: _averaged(free)}, {}
    for law, column in _laws(problem, model.z, hypothesis, place, responses).items():
        alternatives = [of_all(problem, model.extended(scale * column[:, None])) for scale in SCALES]
        evidences[law] = _averaged(alternatives)
        (mean,), ((variance,),) = _moments(alternatives, 1)
        sizes[law] = float(mean), float(np.sqrt(variance))
    total = logsumexp(list(evidences.values()))
    laws = {name: float(np.exp(value - total)) for name, value in evidences.items()}
    return UnknownSource(place, _waveforms(problem, place, free), laws, sizes)


def _waveforms(problem: Problem, place: str, free: list[Posterior]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return `UnknownSource.waveforms`, averaged over the scales."""
    shapes, flow = _standard_basis(), problem.forward.anatomy.flow_scale(place)
    count = len(shapes) * (1 + len(problem.forward.conditions))
    mean, covariance = _moments(free, count)
    found = {}
    for number, name in enumerate(problem.forward.conditions):
        own = np.zeros((len(shapes), count))
        for part in (0, number + 1):
            own[:, part * len(shapes) : (part + 1) * len(shapes)] = np.sqrt(0.5) * np.eye(len(shapes))
        spread = own @ covariance @ own.T
        sd = np.sqrt(np.einsum("kt,kl,lt->t", shapes, spread, shapes))
        found[name] = flow * (own @ mean @ shapes), flow * sd
    return found


def _moments(alternatives: Sequence[Posterior], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return mean (count,) and covariance of a source, averaged over its equally likely scales."""
    each = [one.moments() for one in alternatives]
    means = [scale * mean[-count:] for scale, (mean, _) in zip(SCALES, each, strict=True)]
    within = [scale**2 * covariance[-count:, -count:] for scale, (_, covariance) in zip(SCALES, each, strict=True)]
    return mixture_moments(softmax([one.right for one in alternatives]), np.array(means), np.array(within))


def _columns(problem: Problem, responses: np.ndarray) -> np.ndarray:
    """Return the columns (N, k (1 + conditions)) of a source that is half common to all conditions."""
    names = list(problem.forward.conditions)
    each = [np.where((problem.condition == name)[:, None], responses, 0.0) for name in names]
    return np.sqrt(0.5) * np.hstack([responses, *each])


def _laws(
    problem: Problem, z: np.ndarray, hypothesis: Hypothesis, place: str, responses: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the whitened change (N,) of all predictions by each law, of unit mean magnitude over the beats."""
    pressure, flow = _at(problem.forward, z, hypothesis, place)
    periods = {name: problem.forward.periods[name] for name in pressure}
    slopes = {name: np.gradient(np.r_[p[-1], p, p[0]])[1:-1] * POINTS / periods[name] for name, p in pressure.items()}
    waves: dict[str, dict[str, np.ndarray]] = {
        "leak": pressure, "storage": slopes, "share of the flow": flow,
        "constant": {name: np.ones(POINTS) for name in pressure},
    }  # fmt: skip
    inverse = np.linalg.pinv(_standard_basis().T)
    found = {}
    for law, by_condition in waves.items():
        unit = float(np.mean([np.abs(wave).mean() for wave in by_condition.values()]))
        column = np.zeros(len(responses))
        for name, wave in by_condition.items():
            rows = problem.condition == name
            column[rows] = responses[rows] @ (inverse @ (wave / unit))
        found[law] = column
    return found


def _at(
    forward: Forward, z: np.ndarray, hypothesis: Hypothesis, place: str
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return pressure and flow at the end of a vessel as simulated: condition → (`POINTS`,)."""
    phase, location = np.arange(POINTS) / POINTS, forward.anatomy.outlet(place)
    asked = [
        Measured(name, quantity, location, "waveform", phase * period, period, np.ones(POINTS), np.ones(POINTS))
        for quantity in ("pressure", "flow")
        for name, period in forward.periods.items()
    ]
    simulated = hypothesis.without_measurement_errors(z)
    values = replace(forward, measured=asked, shapes=None).predict(*simulated)[0].reshape(2, -1, POINTS)
    pressure, flow = (dict(zip(forward.periods, rows, strict=True)) for rows in values)
    return pressure, flow


def _standard_basis() -> np.ndarray:
    """Return the shapes (k, `POINTS`) of one prior standard deviation each."""
    sds = [float(one.from_standard(1.0)) for one in SOURCE.parameters]
    return np.array(sds)[:, None] * basis(np.arange(POINTS) / POINTS)


def _averaged(alternatives: Sequence[Posterior]) -> float:
    """Return the log evidence of a right model, averaged over equally likely alternatives."""
    return float(logsumexp([one.right for one in alternatives]) - np.log(len(alternatives)))
