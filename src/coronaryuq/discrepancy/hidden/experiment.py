"""Experiments in which effects are hidden: a network, its conditions and the measurements under each."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Series
from coronaryuq.zerod.network.period import period_of
from coronaryuq.zerod.solver.engine import Engine

HYPERAEMIA = 0.24
"""Coronary resistance in hyperaemia over that at rest."""
MOST_PRESSURES = 3
"""Number of the largest coronary beds whose pressure is measured."""


@dataclass(frozen=True)
class Plan:
    """Measurements in every condition: (quantity, location, statistic, noise as a fraction of the series' size)."""

    entries: tuple[tuple[str, str, str, float], ...]
    points: int = 40

    def series(self, conditions: Iterable[Condition]) -> list[Series]:
        """Return the measured series without times, for the places of effects on the measurements."""
        return [
            Series(condition.name, quantity, place, statistic, np.zeros(1) if statistic == "waveform" else None, 1.0)
            for condition in conditions
            for quantity, place, statistic, _ in self.entries
        ]

    def blank(self, network: Network, conditions: dict[str, Condition], random: np.random.Generator) -> list[Measured]:
        """Return the measured series with times, all values one (perfusion: 1 mL/min/g)."""
        measured = []
        for name, condition in conditions.items():
            period = period_of(apply_condition(network, condition))
            for quantity, location, statistic, _ in self.entries:
                time, count = None, 1
                if statistic == "waveform":
                    # An uneven grid, different from that of the analysis.
                    count = self.points
                    jitter = random.uniform(-0.3, 0.3, count)
                    time = np.sort((np.arange(count) + 0.5 + jitter) / count * period)
                unit = 1.0 if quantity != "perfusion" else 1.0 / 60.0
                value = np.full(count, unit)
                measured.append(Measured(name, quantity, location, statistic, time, period, value, 0.1 * value))
        return measured

    def noise_sd(self, series: list[Measured], predicted: list[np.ndarray], scale: float) -> list[float]:
        """Return the standard deviation of the noise of each series, relative to its largest size in any condition."""
        shares = {entry[:3]: entry[3] for entry in self.entries}
        keys = [(one.quantity, one.location, one.statistic) for one in series]
        sizes: dict[tuple, float] = {}
        for key, values in zip(keys, predicted, strict=True):
            sizes[key] = max(sizes.get(key, 0.0), float(np.abs(values).mean()))
        return [scale * shares[key] * sizes[key] for key in keys]


@dataclass(frozen=True)
class Experiment:
    """A network, its conditions, and the measurements under each."""

    network: Network
    conditions: dict[str, Condition]
    plan: Plan

    @property
    def series(self) -> list[Series]:
        return self.plan.series(self.conditions.values())


def loop_conditions() -> dict[str, Condition]:
    """Return the conditions of a tuned loop: rest, hyperaemia and pacing to fit, a partial dilatation held out."""
    conditions = [
        Condition("rest"),
        Condition("hyperaemia", coronary_resistance_scale=HYPERAEMIA),
        Condition("pacing", period_scale=0.75),
        Condition("half dilated", coronary_resistance_scale=0.5, held_out=True),
    ]
    return {condition.name: condition for condition in conditions}


def loop_experiment(network: Network) -> Experiment:
    """Return the experiment on a tuned loop with the measurements of `clinical_plan`."""
    return Experiment(network, loop_conditions(), clinical_plan(network))


def clinical_plan(network: Network) -> Plan:
    """Return the measurements of a catheter laboratory and a perfusion scan on any network.

    Pressure at the root and before the largest coronary beds, flow into each coronary artery, perfusion of every bed.
    """
    anatomy = Anatomy(network)
    beds = anatomy.beds
    names = {bed: f"mean_flow:{vessel}:{bed}" for bed, vessel in beds.items()}
    result = Engine(network).run_to_periodic(quantities=list(names.values()), steps_per_cycle=300)
    if not result.ok[0]:
        raise InputError("model", None, None, f"the loop does not run: {result.status[0]}")
    order = sorted(beds, key=lambda bed: -float(result.values[names[bed]][0]))
    entries = [("pressure", anatomy.inlet(anatomy.roots[0]), "waveform", 0.02)]
    entries += [("pressure", f"{beds[bed]}:{bed}", "waveform", 0.02) for bed in order[:MOST_PRESSURES]]
    entries += [("flow", anatomy.inlet(vessel), "waveform", 0.05) for vessel in anatomy.ostia]
    entries += [("perfusion", bed, "mean", 0.08) for bed in beds]
    return Plan(tuple(entries))
