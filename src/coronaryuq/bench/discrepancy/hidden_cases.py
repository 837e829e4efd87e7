"""What the benchmark `discrepancy` hides effects in, and effects that the library does not have."""

import copy
from functools import cached_property
from typing import NamedTuple

import numpy as np

from coronaryuq.bench.discrepancy import open_loop_tree
from coronaryuq.case.network.network import Network
from coronaryuq.core import units
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.stage import loop_conditions, plan_of
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.grafting import add_vessel, attach
from coronaryuq.zerod.effects.leak import SideBranchLeak
from coronaryuq.zerod.solver.engine import Engine


class _Parts(NamedTuple):
    network: Network
    conditions: dict[str, Condition]
    plan: make_case.Plan


class Made(_Parts):
    """A network, its conditions, and what is measured under each; and what many cases hidden in it have in common."""

    @cached_property
    def beside_a_stenosis(self) -> "Made":
        return known_stenosis(self)

    @cached_property
    def _traces(self) -> dict[float, make_case.Traces]:
        return {}

    def traces(self, noise: float) -> make_case.Traces:
        """With so many times the plan's noise."""
        if noise not in self._traces:
            self._traces[noise] = make_case.Traces(*self, noise)
        return self._traces[noise]


def open_loop() -> Made:
    """Network, conditions and measurements of the bundled open-loop tree driven by aortic pressure."""
    conditions = [
        Condition("rest"),
        Condition("hyperaemia", coronary_resistance_scale=0.3),
        Condition("pacing", period_scale=0.7),
        Condition("half dilated", coronary_resistance_scale=0.5, held_out=True),
    ]
    waveforms = [
        ("flow", "AORTA:left_main", 0.04),
        ("flow", "J0:lad_proximal", 0.04),
        ("flow", "lcx:BC_lcx", 0.05),
        ("pressure", "AORTA:left_main", 0.02),
        ("pressure", "lad:BC_lad", 0.02),
        ("pressure", "lcx:BC_lcx", 0.02),
    ]
    entries = [(quantity, place, "waveform", sd) for quantity, place, sd in waveforms]
    entries += [("perfusion", f"BC_{bed}", "mean", 0.08) for bed in ("lad", "diagonal", "lcx")]
    return Made(open_loop_tree.left_coronary(), {c.name: c for c in conditions}, make_case.Plan(tuple(entries)))


def closed_loop(network: Network) -> Made:
    """Conditions and measurements of a closed loop: those of the campaign's own hidden case."""
    return Made(network, {c.name: c for c in loop_conditions()}, plan_of(network))


BESIDE_A_STENOSIS = ("collateral", "shifted_territory", "rotated_territories", "delayed_collateral")
"""Effects that leave a trace only where beds differ: on closed loops hidden beside a stenosis that the model knows of,
those of the library strong, at half the noise."""
KNOWN_LOSS = 0.5
"""Mean pressure lost in the stenosis that the model knows of, at the model's own mean flow, over the mean pressure."""


def known_stenosis(made: Made) -> Made:
    """The same with a stenosis in the model itself, in the vessel that feeds nearest half of the beds of an artery.

    Beds that differ neither in pressure nor in how they dilate can show neither a collateral between them nor a map of
    territories that is off.
    """
    network, conditions, plan = made
    network = copy.deepcopy(network)
    anatomy = Anatomy(network)
    artery = max(anatomy.ostia, key=lambda vessel: len(anatomy.beds_below(vessel)))
    half = len(anatomy.beds_below(artery)) / 2
    chosen = min(anatomy.subtree(artery), key=lambda vessel: abs(len(anatomy.beds_below(vessel)) - half))
    scales = _scales(network, [chosen])
    loss = KNOWN_LOSS * scales.pressure / scales.flow[chosen] ** 2
    network.vessel_values(chosen).update({"stenosis_coefficient": loss, "C": 0.0})
    return Made(network, conditions, plan)


def _scales(network: Network, vessels: list[str]) -> Anatomy:
    """Anatomy with the mean pressure at the root and the mean flow of some vessels, of a run of the model as it is."""
    anatomy = Anatomy(network)
    names = [f"mean_pressure:{anatomy.inlet(anatomy.roots[0])}", *(f"mean_flow:{anatomy.inlet(v)}" for v in vessels)]
    pressure, *flows = (float(v[0]) for v in Engine(network).run(quantities=names, periodic=True).values.values())
    return Anatomy(network, pressure, dict(zip(vessels, flows, strict=True)))


def outside(name: str, network: Network, random: np.random.Generator):
    """A change of a condition's network that no effect of the library expresses; in a closed loop at a random place.

    None where the loop has no place for it: no second bed to be swapped with.
    """
    anatomy = Anatomy(network)
    vessel, bed, swapped = "lad_proximal", "BC_lcx", ("BC_lad", "BC_diagonal", "BC_lcx")
    if anatomy.closed_loop:
        fed = {one: len(anatomy.beds_below(one)) for one in anatomy.coronary_vessels}
        shared = [one for one, beds in fed.items() if beds >= min(3, max(fed.values()))]
        vessel = shared[int(random.integers(len(shared)))]
        left, *others = (anatomy.beds_below(ostium) for ostium in anatomy.ostia)
        bed = left[int(random.integers(len(left)))]
        # A second artery's, or, where one coronary feeds the heart, another one of its own.
        right = others[0] if others else [one for one in left if one != bed]
        if name == "miswired_outlets" and not right:
            return None
        swapped = (bed, right[int(random.integers(len(right)))]) if right else ()
        if name in COMING_AND_GOING:
            return _coming_and_going(name, network, vessel, shared, random)
    order = {"rest": 0.0, "hyperaemia": 1.0, "pacing": 2.0, "half dilated": 1.5}

    def scale(network, names, factor):
        for _, name, _, values in network.elements():
            for key in ("R_poiseuille", "Ra1", "Ra2", "Rv1", "Ra", "Ram", "Rv"):
                if name == names and key in values:
                    values[key] *= factor
        return network

    def miswired(network, condition):
        blocks = [network.bed(name) for name in swapped]
        values = [block["bc_values"] for block in blocks]
        for block, other in zip(blocks, [values[-1], *values[:-1]], strict=True):
            block["bc_values"] = other
        return network

    def pump(network, condition):
        """Intramyocardial pressure of the LAD's bed turned upside down: an aneurysm that bulges in systole."""
        values = network.bed_values("BC_lad")
        pressure = np.asarray(values["Pim"])
        values["Pim"] = (pressure.max() + pressure.min() - pressure).tolist()
        return network

    def thrombosed(network, condition):
        """A side vessel behind the left main's first branch that lets blood through in late diastole only."""
        aorta = network.bed_values("AORTA")
        open_late = np.arange(len(aorta["t"])) > 0.55 * len(aorta["t"])
        beyond = np.where(open_late, 5.0 * units.MMHG, aorta["P"])
        block = {"bc_name": "CLOT", "bc_type": "PRESSURE", "bc_values": {"t": list(aorta["t"]), "P": beyond.tolist()}}
        network["boundary_conditions"].append(block)
        number = add_vessel(network, "side", {"R_poiseuille": 85.0 * units.MMHG / 0.8}, outlet="CLOT")
        attach(network, "J1", "outlet", number)
        return network

    return {
        "thrombosed_side_vessel": thrombosed,
        "drifting_vessel": lambda n, c: scale(n, vessel, 1.0 + 12.0 * order[c]),
        "drifting_bed": lambda n, c: scale(n, bed, 1.0 + 0.5 * order[c]),
        "miswired_outlets": miswired,
        "bulging_territory": pump,
    }[name]


def _coming_and_going(name: str, network: Network, vessel: str, vessels: list[str], random: np.random.Generator):
    """What is there under some conditions of a loop only; None where it wants a junction, or two, that are not there.

    vessels: among which a second one is chosen, with other beds.
    """
    anatomy = Anatomy(network)
    own = set(anatomy.beds_below(vessel))
    apart = [v for v in vessels if own.isdisjoint(anatomy.beds_below(v)) and v not in anatomy.outlet_bc]
    if name != "spasm" and vessel in anatomy.outlet_bc or name == "delayed_collateral" and not apart:
        return None
    other = apart[int(random.integers(len(apart)))] if apart else vessel
    scales = _scales(network, list(dict.fromkeys([vessel, other])))

    def spasm(network, condition):
        """A vessel that narrows while the heart is paced, and at no other time."""
        if condition == "pacing":
            network.vessel_values(vessel)["R_poiseuille"] += 0.1 * scales.pressure / scales.flow[vessel]
        return network

    def clot(network, condition):
        """A side vessel that thromboses while one condition after the other is recorded."""
        share = {"rest": 0.4, "hyperaemia": 0.2, "half dilated": 0.1, "pacing": 1e-6}[condition]
        leak = SideBranchLeak()
        network = leak.insert(network, vessel, scales)
        values = leak.changes(network, vessel, {"share": share}, scales, None)
        network.bed_values(f"BC_leak_{vessel}").update({key.split(".")[1]: value for key, value in values.items()})
        return network

    def recruited(network, condition):
        """A collateral that opens only where the beds behind it dilate."""
        conductance = 0.5 if condition in ("hyperaemia", "half dilated") else 1e-6
        flow = min(scales.flow[vessel], scales.flow[other])
        number = add_vessel(network, "recruited", {"R_poiseuille": scales.pressure / (conductance * flow)})
        attach(network, anatomy.downstream[vessel], "outlet", number)
        attach(network, anatomy.downstream[other], "inlet", number)
        return network

    return {"spasm": spasm, "thrombosed_side_vessel": clot, "delayed_collateral": recruited}[name]


OUTSIDE = ("thrombosed_side_vessel", "drifting_vessel", "drifting_bed", "miswired_outlets", "bulging_territory")
COMING_AND_GOING = ("spasm", "thrombosed_side_vessel", "delayed_collateral")
"""Those of a closed loop that are there under some conditions only."""
OUTSIDE_LOOP = ("drifting_vessel", "drifting_bed", "miswired_outlets", *COMING_AND_GOING)
"""Those of a closed loop, which keeps its blood and whose beds are compressed by its own heart."""
