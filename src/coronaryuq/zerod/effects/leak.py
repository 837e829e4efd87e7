"""Blood that leaves a vessel on a path missing from the model: a side branch, or a leak to the veins."""

from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import numpy as np

from coronaryuq.case.network.network import COPY_OF, GRAFTED, Network
from coronaryuq.zerod.effects.anatomy import COMPLIANCES, RESISTANCES, Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Number, Parameter, Series, Values
from coronaryuq.zerod.effects.grafting import (
    DISTAL,
    add_vessel,
    attach,
    grafted_name,
    locations_renamed,
    open_end,
)
from coronaryuq.zerod.network.waveforms import sampled

CLOSED = 1e-9
"""Fraction of a usual flow that an added path carries before `changes` opens it."""


class SideBranchLeak(Effect):
    """Flow lost at the end of a vessel to the veins, through a resistance that does not dilate, as of a fistula."""

    name = "side_branch_leak"
    formula = "Q_leak = (P - P_v) / R_leak at the vessel's end; P_v = 0 in an open loop"
    source = "Mangukia, Ann. Thorac. Surg. 93 (2012) 2084 (coronary artery fistula)"
    signature = (
        "flow into the vessel above the sum of the flows out of it, by an amount in proportion to pressure that does "
        "not rise as the beds dilate; distal pressures slightly lower"
    )
    native = "a BloodVessel with a RESISTANCE (open loop) or ClosedLoopRCR (closed loop) outlet"
    grafted = True
    acts_as_source = True
    parameters = (Parameter("share", "1", "lognormal", 0.2, 1.0, "leak over the mean flow of the vessel in the model"),)
    tag, added = "leak", "leak"
    """Suffix of the stub to the bed, and prefix of the added vessel."""

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return anatomy.coronary_vessels

    def insert(self, network: Network, place: str, anatomy: Anatomy) -> Network:
        network, junction, _ = open_end(network, place, self.tag)
        bed = self._bed(network, place)
        leak = add_vessel(network, f"{self.added}~{place}", {"R_poiseuille": 0.0}, outlet=bed)
        network["boundary_conditions"].append({"bc_name": bed, **self._closed(place, anatomy)})
        attach(network, junction, "outlet", leak)
        return network

    def _closed(self, place: str, anatomy: Anatomy) -> dict[str, Any]:
        """Return type and values of the bed before it is opened."""
        weak = anatomy.pressure / (CLOSED * anatomy.flow_scale(place))
        if anatomy.closed_loop:
            values = {"Rp": 0.1 * weak, "Rd": 0.9 * weak, "C": 0.0, "closed_loop_outlet": True}
            return {"bc_type": "ClosedLoopRCR", "bc_values": values}
        return {"bc_type": "RESISTANCE", "bc_values": {"R": weak, "Pd": 0.0}}

    def aliases(self, place: str, anatomy: Anatomy) -> dict[str, str]:
        return locations_renamed(anatomy, place, self.tag)

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        resistance, bed = self._resistance(place, sizes["share"], anatomy), self._bed(network, place)
        if anatomy.closed_loop:
            return {f"{bed}.Rp": 0.1 * resistance, f"{bed}.Rd": 0.9 * resistance}
        return {f"{bed}.R": resistance}

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return {"resistance of the leak": self._resistance(place, sizes["share"], anatomy)}

    def _bed(self, network: Network, place: str) -> str:
        return f"BC_{grafted_name(network, f'{self.added}~{place}')}"

    @staticmethod
    def _resistance(place: str, share: Number, anatomy: Anatomy) -> Number:
        return anatomy.pressure / (share * anatomy.flow_scale(place))


class SideBranch(SideBranchLeak):
    """Flow lost at the end of a vessel to a side branch whose bed dilates and is compressed as those beyond the vessel.

    The bed is a copy of the first one beyond the vessel, with resistances and compliances in proportion to the share:
    what conditions, recalibration and other effects change there, changes here.
    """

    name = "side_branch"
    formula = "1 / R_branch = s sum(1 / R_i), R_i of the beds beyond the vessel's end; compliances in proportion"
    source = "Gosling et al., J. Biomech. 103 (2020) 109698 (side-branch flow)"
    signature = "flow into the vessel above the sum of the flows out of it, by the same fraction in every condition"
    native = "a BloodVessel with a bed of the kind of those beyond it"
    parameters = (
        Parameter("share", "1", "lognormal", 0.2, 1.0, "conductance of the branch over that of the beds beyond it"),
    )
    tag, added = "branch", "side_branch"

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        beds = {name: network.bed_values(name) for name in anatomy.beds_below(place)}
        conductances = {name: 1.0 / sum(values.get(one, 0.0) for one in RESISTANCES) for name, values in beds.items()}
        bed, first = self._bed(network, place), _first_bed(place, anatomy)
        opened, values = sizes["share"] * sum(conductances.values()) / conductances[first], beds[first]
        changes = {f"{bed}.{name}": value / opened for name, value in values.items() if name in RESISTANCES}
        changes |= {f"{bed}.{name}": value * opened for name, value in values.items() if name in COMPLIANCES}
        # Of the rest, such as the back pressure, only what other effects have changed differs from the copy's own.
        for name, value in values.items():
            kept = np.array_equal(value, network.bed_values(bed)[name])
            if not (kept or name == "t" or f"{bed}.{name}" in changes):
                changed = sampled(network, f"{first}.{name}") if np.ndim(value) else value
                changes[f"{bed}.{name}"] = np.repeat([changed], np.size(opened), axis=0)
        return changes

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return dict(sizes)

    def _closed(self, place: str, anatomy: Anatomy) -> dict[str, Any]:
        first = deepcopy(anatomy.blocks[_first_bed(place, anatomy)])
        values = first["bc_values"]
        values |= {name: values[name] / CLOSED for name in RESISTANCES if name in values}
        values |= {name: values[name] * CLOSED for name in COMPLIANCES if name in values}
        return {"bc_type": first["bc_type"], "bc_values": values, COPY_OF: first["bc_name"]}


def _first_bed(place: str, anatomy: Anatomy) -> str:
    """Return the first bed beyond a vessel in the order of the file, which added vessels do not change."""
    added = {f"BC_{vessel['vessel_name']}" for vessel in anatomy.network.vessels if GRAFTED in vessel}
    below = set(anatomy.beds_below(place)) - added
    return next(bed for bed in anatomy.blocks if bed in below)


class DistalLeak(SideBranchLeak):
    """Flow lost to a side branch beyond the flow probe at the end of a vessel.

    The probe measures the leak as well, perfusion does not. It resembles a bed of lower resistance that neither dilates
    nor is compressed: incomplete hyperaemia, a gain of the probe.
    """

    name = "distal_leak"
    formula = "Q_leak = (P - P_v) / R_leak beyond the probe at the vessel's end; P_v = 0 in an open loop"
    signature = (
        "measured flow into a bed too high, by an amount in proportion to pressure that does not rise as it dilates"
    )
    beyond_probes = True
    tag, added = DISTAL, "distal_leak"

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        probes = {s.location for s in observed if s.quantity == "flow"}
        return [vessel for vessel in anatomy.beds.values() if anatomy.outlet(vessel) in probes]
