"""The next measurement: which feasible one would best distinguish the candidates of a class."""

from dataclasses import replace

import numpy as np

from coronaryuq.core import units
from coronaryuq.core.expected_information import information
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.selection.candidates import Round
from coronaryuq.discrepancy.selection.discovery import Discovery

SD_PRESSURE = 2.0 * units.MMHG
"""Standard deviation of a pressure wire's mean (drift included)."""
SD_FLOW = 0.1
"""Relative standard deviation of a mean flow (Doppler wire, phase-contrast MRI, perfusion map)."""
LEAST_FLOW = 1e-6
"""Smallest flow, mL/s, of which a flow's standard deviation is a fraction."""
BEST = 3
"""Maximum number of measurements that are returned."""


def next_measurements(discovery: Discovery, entry: Round) -> list[dict]:
    """Rank mean pressures and flows by the expected information on which candidate of a class is true.

    Each candidate is at its best fit, with the noise of the new measurement alone: an upper bound. The new measurement
    is made by another instrument, which does not have the errors of those in use.

    Parameters
    ----------
    discovery
        Answer of a search.
    entry
        The round that named the class.

    Returns
    -------
    list of dict
        Best first: `quantity`, `location`, `condition`, `statistic`, `already_measured` and
        `expected_information_nats`; empty for a class of one.
    """
    forward, count = discovery.problem.forward, discovery.problem.count
    models = [(c.fitted.z, entry.others.with_(c.placed)) for c in entry.members if c.fit is not None]
    models = [(z, model) for z, model in models if len(z) == count + len(model.parameters)]
    if len(models) < 2:
        return []
    feasible = _feasible(forward)
    asked = replace(forward, measured=feasible, shapes=None)
    predicted = asked.predict_rows([model.without_measurement_errors(z) for z, model in models])
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


def _feasible(forward: Forward) -> list[Measured]:
    """Return mean flow and pressure at both ends of every vessel under study, in every condition."""
    anatomy = forward.anatomy
    places = [f(v) for v in anatomy.coronary_vessels for f in (anatomy.inlet, anatomy.outlet)]
    one = np.ones(1)
    return [
        Measured(name, quantity, place, "mean", None, forward.periods[name], one, one)
        for name in forward.conditions
        for quantity in ("pressure", "flow")
        for place in dict.fromkeys(places)
    ]
