"""Networks in which the benchmark `discrepancy` hides effects, and effects outside the library."""

import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from coronaryuq.bench.discrepancy import open_loop_tree, set_aside
from coronaryuq.bench.discrepancy.recordings_outside import RECORDINGS
from coronaryuq.bench.discrepancy.traces import Traces
from coronaryuq.case.network.network import Network
from coronaryuq.core import units
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.hidden.experiment import Experiment, Plan, loop_experiment
from coronaryuq.discrepancy.hidden.make_case import Subject, draw_subject
from coronaryuq.discrepancy.hidden.nature import Change, Nature, Outside
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState
from coronaryuq.zerod.effects.grafting import add_vessel, attach
from coronaryuq.zerod.effects.leak import SideBranchLeak
from coronaryuq.zerod.effects.misattached_branch import MisattachedBranch
from coronaryuq.zerod.solver.engine import Engine

MOST_SUBJECTS = 4
"""Subjects kept; cells with one seed follow each other and share them."""


@dataclass(frozen=True)
class BenchmarkExperiment(Experiment):
    """An experiment with cached results that many cases hidden in it share."""

    @cached_property
    def with_stenosis(self) -> "BenchmarkExperiment":
        """The experiment with a known stenosis; see `known_stenosis`."""
        return known_stenosis(self)

    @cached_property
    def _traces(self) -> dict[float, Traces]:
        return {}

    def traces(self, noise: float) -> Traces:
        """Return the signals of effects under a multiple of the plan's noise."""
        if noise not in self._traces:
            self._traces[noise] = Traces(self, noise)
        return self._traces[noise]

    @cached_property
    def _subjects(self) -> dict[tuple[Nature, int], Subject]:
        return {}

    def subject(self, nature: Nature, seed: int) -> Subject:
        """Return the subject of a seed, in which all cells hide their effects."""
        if (nature, seed) not in self._subjects:
            if len(self._subjects) >= MOST_SUBJECTS:
                del self._subjects[next(iter(self._subjects))]
            self._subjects[nature, seed] = draw_subject(self, nature, seed)
        return self._subjects[nature, seed]


def open_loop() -> BenchmarkExperiment:
    """Return the experiment on the bundled open-loop tree driven by aortic pressure."""
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
    named = {condition.name: condition for condition in conditions}
    return BenchmarkExperiment(open_loop_tree.left_coronary(), named, Plan(tuple(entries)))


def closed_loop(network: Network) -> BenchmarkExperiment:
    """Return the experiment on a closed loop, the same as that of a campaign."""
    return BenchmarkExperiment(**vars(loop_experiment(network)))


WITH_STENOSIS = ("collateral", "shifted_territory", "rotated_territories", "delayed_collateral")
"""Effects that are detectable only if beds differ: in closed loops they are hidden together with a stenosis that is in
the model; effects of the library are then strong, at half the noise."""
KNOWN_LOSS = 0.5
"""Pressure loss of the known stenosis at the model's mean flow, over the mean pressure."""


def known_stenosis(experiment: BenchmarkExperiment) -> BenchmarkExperiment:
    """Return the experiment with a stenosis in the model, in the vessel that feeds about half of an artery's beds.

    If beds differ neither in pressure nor in dilatation, a collateral between them or misplaced territories cannot be
    detected.
    """
    network = copy.deepcopy(experiment.network)
    anatomy = Anatomy(network)
    artery = max(anatomy.ostia, key=lambda vessel: len(anatomy.beds_below(vessel)))
    half = len(anatomy.beds_below(artery)) / 2
    chosen = min(anatomy.subtree(artery), key=lambda vessel: abs(len(anatomy.beds_below(vessel)) - half))
    scales = _scales(network, [chosen])
    loss = KNOWN_LOSS * scales.pressure / scales.flow[chosen] ** 2
    network.vessel_values(chosen).update({"stenosis_coefficient": loss, "C": 0.0})
    return replace(experiment, network=network)


def _scales(network: Network, vessels: list[str]) -> Anatomy:
    """Anatomy with the mean root pressure and the mean flow of some vessels from a reference run."""
    anatomy = Anatomy(network)
    names = [f"mean_pressure:{anatomy.inlet(anatomy.roots[0])}", *(f"mean_flow:{anatomy.inlet(v)}" for v in vessels)]
    pressure, *flows = (float(v[0]) for v in Engine(network).run_to_periodic(quantities=names).values.values())
    return Anatomy(network, pressure, dict(zip(vessels, flows, strict=True)))


def outside(name: str, experiment: Experiment, random: np.random.Generator) -> Outside | None:
    """Return an effect that the library does not express, at a random place; None if it has none."""
    if name in set_aside.EFFECTS:
        return set_aside.EFFECTS[name](experiment, random)
    if name in RECORDINGS:
        channels = [entry[:2] for entry in experiment.plan.entries if entry[2] == "waveform"]
        return RECORDINGS[name](channels, random)
    change = changed_network(name, experiment.network, random)
    return Outside(network=change) if change else None


def changed_network(name: str, network: Network, random: np.random.Generator) -> Change | None:
    """Return a change of a condition's network that no effect of the library expresses; None if it has no place.

    In a closed loop the place is random.
    """
    if name == REWIRED:
        return _rewired(network, random)
    anatomy = Anatomy(network)
    vessel, bed = "lad_proximal", "BC_lcx"
    swapped: tuple[str, ...] = ("BC_lad", "BC_diagonal", "BC_lcx")
    if anatomy.closed_loop:
        fed = {one: len(anatomy.beds_below(one)) for one in anatomy.coronary_vessels}
        shared = [one for one, beds in fed.items() if beds >= min(3, max(fed.values()))]
        vessel = shared[int(random.integers(len(shared)))]
        left, *others = (anatomy.beds_below(ostium) for ostium in anatomy.ostia)
        bed = left[int(random.integers(len(left)))]
        # A bed of a second artery or, if a single artery feeds the heart, another one of its beds.
        right = others[0] if others else [other for other in left if other != bed]
        if name == "miswired_outlets" and not right:
            return None
        swapped = (bed, right[int(random.integers(len(right)))]) if right else ()
        if name in TRANSIENT:
            return _transient(name, network, vessel, shared, random)
    order = {"rest": 0.0, "hyperaemia": 1.0, "pacing": 2.0, "half dilated": 1.5}

    def scale(network: Network, name: str, factor: float) -> Network:
        for block in network["boundary_conditions"]:
            if block["bc_name"] == name:
                for key in ("Ra1", "Ra2", "Rv1", "Ra", "Ram", "Rv"):
                    if key in block["bc_values"]:
                        block["bc_values"][key] *= factor
        for vessel in network["vessels"]:
            if vessel["vessel_name"] == name:
                vessel["zero_d_element_values"]["R_poiseuille"] *= factor
        return network

    def miswired(network: Network, condition: str) -> Network:
        blocks = [next(b for b in network["boundary_conditions"] if b["bc_name"] == name) for name in swapped]
        values = [block["bc_values"] for block in blocks]
        for block, other in zip(blocks, [values[-1], *values[:-1]], strict=True):
            block["bc_values"] = other
        return network

    def bulging(network: Network, condition: str) -> Network:
        """Invert the intramyocardial pressure of the LAD bed: an aneurysm that bulges in systole."""
        for block in network["boundary_conditions"]:
            if block["bc_name"] == "BC_lad":
                pressure = np.asarray(block["bc_values"]["Pim"])
                block["bc_values"]["Pim"] = (pressure.max() + pressure.min() - pressure).tolist()
        return network

    def thrombosed(network: Network, condition: str) -> Network:
        """Add a side vessel distal to the first bifurcation that carries blood only in late diastole."""
        aorta = next(b["bc_values"] for b in network["boundary_conditions"] if b["bc_name"] == "AORTA")
        open_late = np.arange(len(aorta["t"])) > 0.55 * len(aorta["t"])
        distal = np.where(open_late, 5.0 * units.MMHG, aorta["P"])
        block = {"bc_name": "CLOT", "bc_type": "PRESSURE", "bc_values": {"t": list(aorta["t"]), "P": distal.tolist()}}
        network["boundary_conditions"].append(block)
        number = add_vessel(network, "side", {"R_poiseuille": 85.0 * units.MMHG / 0.8}, outlet="CLOT")
        attach(network, "J1", "outlet", number)
        return network

    return {
        "thrombosed_side_vessel": thrombosed,
        "drifting_vessel": lambda n, c: scale(n, vessel, 1.0 + 12.0 * order[c]),
        "drifting_bed": lambda n, c: scale(n, bed, 1.0 + 0.5 * order[c]),
        "miswired_outlets": miswired,
        "bulging_territory": bulging,
    }[name]


def _rewired(network: Network, random: np.random.Generator) -> Change | None:
    """Return the connection of a random branch to another vessel; None if no branch has one near."""
    wiring = MisattachedBranch()
    places = wiring.places(Anatomy(network))
    if not places:
        return None
    place = places[int(random.integers(len(places)))]
    return lambda network, _: wiring.corrected(network, place)[0]


def _transient(
    name: str, network: Network, vessel: str, vessels: list[str], random: np.random.Generator
) -> Change | None:
    """Return a change present under some conditions only; None if the loop has no suitable junctions.

    vessels: candidates for a second vessel with other beds.
    """
    anatomy = Anatomy(network)
    own = set(anatomy.beds_below(vessel))
    apart = [v for v in vessels if own.isdisjoint(anatomy.beds_below(v)) and v not in anatomy.outlet_bc]
    if name != "spasm" and vessel in anatomy.outlet_bc or name == "delayed_collateral" and not apart:
        return None
    other = apart[int(random.integers(len(apart)))] if apart else vessel
    scales = _scales(network, list(dict.fromkeys([vessel, other])))

    def spasm(network: Network, condition: str) -> Network:
        """Narrow a vessel during pacing only."""
        if condition == "pacing":
            network.vessel_values(vessel)["R_poiseuille"] += 0.1 * scales.pressure / scales.flow[vessel]
        return network

    def clot(network: Network, condition: str) -> Network:
        """Add a side vessel that closes progressively from one condition to the next."""
        share = {"rest": 0.4, "hyperaemia": 0.2, "half dilated": 0.1, "pacing": 1e-6}[condition]
        leak = SideBranchLeak()
        network = leak.insert(network, vessel, scales)
        state = ConditionState(1.0, scales.period, {}, {}, {})
        values = leak.changes(network, vessel, {"share": np.array(share)}, scales, state)
        network.bed_values(f"BC_leak_{vessel}").update(
            {key.split(".")[1]: float(value) for key, value in values.items()}
        )
        return network

    def recruited(network: Network, condition: str) -> Network:
        """Add a collateral that opens only if the distal beds dilate."""
        conductance = 0.5 if condition in ("hyperaemia", "half dilated") else 1e-6
        flow = min(scales.flow[vessel], scales.flow[other])
        number = add_vessel(network, "recruited", {"R_poiseuille": scales.pressure / (conductance * flow)})
        attach(network, anatomy.downstream[vessel], "outlet", number)
        attach(network, anatomy.downstream[other], "inlet", number)
        return network

    return {"spasm": spasm, "thrombosed_side_vessel": clot, "delayed_collateral": recruited}[name]


REWIRED = "rewired_branch"
NETWORKS_OUTSIDE = (
    "thrombosed_side_vessel",
    "drifting_vessel",
    "drifting_bed",
    "miswired_outlets",
    "bulging_territory",
    REWIRED,
)
TRANSIENT = ("spasm", "thrombosed_side_vessel", "delayed_collateral")
"""Effects in a closed loop that are present under some conditions only."""
LOOPS_OUTSIDE = ("drifting_vessel", "drifting_bed", "miswired_outlets", *TRANSIENT, REWIRED)
"""Effects outside the library in a closed loop, which conserves its blood volume and includes the heart."""
OUTSIDE, OUTSIDE_LOOP = (*NETWORKS_OUTSIDE, *RECORDINGS), (*LOOPS_OUTSIDE, *RECORDINGS)
"""Effects outside the library for development, in the open loop and in closed loops."""
