"""The measurement that would tell candidates of one class apart, chosen from a list of feasible ones."""

from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from coronaryuq.core import units
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.selection.forward_step import Round
from coronaryuq.discrepancy.selection.search import Discovery

SD_PRESSURE = 2.0 * units.MMHG
"""Standard deviation of a pressure wire's mean (drift included)."""
SD_FLOW = 0.1
"""Relative standard deviation of a mean flow (Doppler wire, phase-contrast MRI, perfusion map)."""
LEAST_FLOW = 1e-6
"""mL/s below which a flow is none."""
BEST = 3
NODES = 40
"""Of the quadrature over what may be read."""


def separating(found: Discovery, entry: Round) -> list[dict]:
    """Mean pressures and flows ranked by the expected information (nats) on which of a class is true.

    Each member at its own best fit, with the noise of the new measurement alone: what a reading can tell at most. The
    new one is by another instrument, which does not share an error of those in use. Empty for a class of one.
    """
    members = [c for c in entry.members if c.fit is not None]
    if len(members) < 2:
        return []
    forward = found.problem.forward
    feasible = _feasible(forward)
    asked = replace(forward, measured=feasible, shapes=None)
    count = len(forward.nuisances)
    rows = [(c.fit.z, entry.beside.with_(c.placed)) for c in members]
    usable = [_of_the_patient(z, hypothesis) for z, hypothesis in rows if len(z) == count + len(hypothesis.parameters)]
    if len(usable) < 2:
        return []
    predicted = asked.predict_rows(usable)
    scale = np.abs(predicted).mean(axis=0)
    flow_sd = SD_FLOW * np.maximum(scale, LEAST_FLOW)
    sd = np.where([s.quantity == "pressure" for s in feasible], SD_PRESSURE, flow_sd)
    gained = information(predicted / sd)
    order = np.argsort(-np.nan_to_num(gained), kind="stable")[:BEST]
    known = {(s.condition, s.quantity, s.location) for s in forward.measured}
    return [
        {
            "quantity": feasible[i].quantity,
            "location": feasible[i].location,
            "condition": feasible[i].condition,
            "statistic": "mean",
            "already_measured": (feasible[i].condition, feasible[i].quantity, feasible[i].location) in known,
            "expected_information_nats": float(gained[i]),
        }
        for i in order
    ]


def information(predicted: np.ndarray) -> np.ndarray:
    """Expected information (nats) of Gaussian measurements with unit noise on which of m equally likely predictions
    (m, n) is true, (n,): log m at most, (a - b)^2 / 8 for two close ones (Lindley 1956). By Gauss-Hermite quadrature.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    found = np.zeros(predicted.shape[1])
    for mine in predicted:
        read = mine + nodes[:, None]
        behind = 0.5 * (nodes[:, None] ** 2 - (read[None] - predicted[:, None, :]) ** 2)
        found += weights @ (np.log(len(predicted)) - logsumexp(behind, axis=0))
    return found / len(predicted) / weights.sum()


def _of_the_patient(z: np.ndarray, hypothesis: Hypothesis) -> tuple[np.ndarray, Hypothesis]:
    """A row without the effects on the measuring side."""
    for placed in hypothesis:
        if placed.effect.side == "measurement":
            z, hypothesis = hypothesis.drop(z, placed), hypothesis.without(placed)
    return z, hypothesis


def _feasible(forward) -> list[Measured]:
    """Mean flow and pressure at the start and end of every vessel under study, in every condition."""
    anatomy = forward.anatomy
    places = [f(v) for v in anatomy.coronary_vessels for f in (anatomy.inlet, anatomy.outlet)]
    one = np.ones(1)
    return [
        Measured(name, quantity, place, "mean", None, forward.periods[name], one, one)
        for name in forward.conditions
        for quantity in ("pressure", "flow")
        for place in dict.fromkeys(places)
    ]
