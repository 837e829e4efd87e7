"""Cases whose measurements come from the 3D ensemble solver: one vessel of a closed loop as a tube."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coronaryuq.bench.coronary_tree import LENGTH, synthetic_loop
from coronaryuq.case.network.build import Physics, stenosis_coefficient
from coronaryuq.case.network.network import Network
from coronaryuq.core import units
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.hidden.experiment import HYPERAEMIA, Experiment, Plan, clinical_plan
from coronaryuq.discrepancy.hidden.nature import OUR_ENGINE
from coronaryuq.flow3d.adapter import FlowModel
from coronaryuq.flow3d.ensemble.ensemble import Ensemble
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.mesh.description import Couples, Face, MeshDescription
from coronaryuq.flow3d.mesh.read_mesh import Domain
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.verification.tube import tube
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.differences import differences
from coronaryuq.zerod.solver.engine import Engine

PLACES = ("lca0_seg0", "lca1")
"""An inner and a terminal vessel of the tree."""
STENOSES = {"mild": 0.6, "moderate": 0.5, "severe": 0.4}
"""Minimum radius over the healthy one: area reductions of 64, 75 and 84 %."""
NARROWED = 0.75
"""Radius of a diffusely narrowed vessel over the healthy one."""
TAPER = 0.1
"""Fraction of a narrowed vessel's length over which its radius changes at either end."""
RUN = Settings(steps_per_cycle=600, min_cycles=3, max_cycles=3, wall_samples_per_cycle=20, checkpoints=False, fields=0)
RINGS, LEVELS = 4, 60
"""Cells from the axis to the wall, and along the vessel: 3,721 nodes."""


@dataclass(frozen=True)
class Shape:
    """Shape of the 3D vessel. kind: "healthy", "narrowed", or a degree of stenosis."""

    place: str
    kind: str

    @property
    def label(self) -> str:
        return f"{self.place}:{self.kind}"

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects of the library that represent the shape."""
        return {"healthy": (), "narrowed": ("diffuse_narrowing",)}.get(self.kind, ("stenosis_with_viscous_loss",))

    def radius(self, along: np.ndarray) -> np.ndarray:
        """Return the relative radius at fractions of the length; a stenosis is a cosine over the middle 40 %."""
        if self.kind == "healthy":
            return np.ones_like(along)
        if self.kind == "narrowed":
            inside = np.clip(np.minimum(along, 1.0 - along) / TAPER, 0.0, 1.0)
            return 1.0 - (1.0 - NARROWED) * np.sin(0.5 * np.pi * inside) ** 2
        within = np.clip((along - 0.5) / 0.2, -1.0, 1.0)
        return 1.0 - (1.0 - STENOSES[self.kind]) * np.cos(0.5 * np.pi * within) ** 2


SHAPES = tuple(Shape(place, kind) for place in PLACES for kind in ("healthy", "narrowed", *STENOSES))


def loop_3d() -> Experiment:
    """Return the experiment on the 0D loop of healthy vessels, with a partial dilatation held out.

    All conditions have one heart rate, so that the 3D solver runs them in one batch. In addition to the measurements on
    any loop, the pressure distal to both `PLACES` and the flow through them are measured.
    """
    network = synthetic_loop(left=3, right=2, end_radius=0.12, stenosed=False)
    conditions = [
        Condition("rest"),
        Condition("hyperaemia", coronary_resistance_scale=HYPERAEMIA),
        Condition("afterload", scale={"BC_RCR1": {"Rd": 1.3}}),
        Condition("half dilated", coronary_resistance_scale=0.5, held_out=True),
    ]
    anatomy = Anatomy(network)
    entries = list(clinical_plan(network).entries)
    for place in PLACES:
        for entry in (
            ("pressure", anatomy.outlet(place), "waveform", 0.02),
            ("flow", anatomy.inlet(place), "waveform", 0.05),
        ):
            if entry[:3] not in [present[:3] for present in entries]:
                entries.append(entry)
    return Experiment(network, {condition.name: condition for condition in conditions}, Plan(tuple(entries)))


def hide(shape: Shape, seeds: Sequence[int], folders: Sequence[Path]) -> list[make_case.Truth]:
    """Run a vessel of this shape in 3D under all conditions and write a case for each seed into its folder.

    Seeds differ in nuisance parameters and noise; a batch runs as many as there are lanes.
    """
    experiment = loop_3d()
    cases = [make_case.draw_subject(experiment, OUR_ENGINE, seed) for seed in seeds]
    batch = max(1, LANES // len(experiment.conditions))
    truths = []
    for first in range(0, len(cases), batch):
        block = cases[first : first + batch]
        results = _run(shape, experiment, block)
        chosen = slice(first, first + batch)
        for case, waveforms, seed, folder in zip(block, results, seeds[chosen], folders[chosen], strict=True):
            signal, noise = case.signal_of(waveforms, *_nearest(shape, case, waveforms)), make_case.Noise()
            truths.append(case.write(signal, noise, seed, folder, case.visible(signal, noise)))
    return truths


def _run(shape: Shape, experiment: Experiment, cases: list[make_case.Subject]) -> list[dict]:
    """Waveforms of each case, condition → unknown → (steps + 1,)."""
    network, conditions = experiment.network, experiment.conditions
    tables, starts = [], []
    for condition in conditions.values():
        changed = apply_condition(network, condition)
        # All runs of a condition have the blood volume of the analyst's model under it.
        starts.append(Engine(changed).run_to_periodic(steps_per_cycle=300).state[0])
        for case in cases:
            table, _ = case.problem.forward.condition_changes(condition.name, case.nuisance, PLAIN)
            tables.append(differences(network, changed) | table)
    engine = Engine(network)
    changes = {
        name: np.array([table.get(name, engine.parameters[name]) for table in tables])
        for name in dict.fromkeys(name for table in tables for name in table)
    }
    forward = cases[0].problem.forward
    places = dict.fromkeys(name for series in forward.measured for name in forward.variables(series.channel, {}))
    names = list(places | dict.fromkeys(_drop(shape, network)))
    own = _domain(shape, network), shape_in_0d(shape, network), forward.root(None)
    model = FlowModel(*own, units.BLOOD_DENSITY, units.BLOOD_VISCOSITY)
    begin = np.repeat(starts, len(cases), axis=0)
    outcomes = Ensemble(model, RUN).run(changes, len(tables), waveforms=names, start=begin)
    failed = next((one.reason for one in outcomes if not one.ok), None)
    if failed is not None:
        raise FloatingPointError(f"the hidden case does not run in 3D: {failed}")
    return [
        {name: outcomes[k * len(cases) + number].waveforms for k, name in enumerate(conditions)}
        for number in range(len(cases))
    ]


def healthy_radius(network: Network, place: str) -> float:
    """Radius (cm) of the tube with the resistance and inertance of the 0D vessel."""
    values = network.vessel_values(place)
    physics = Physics()
    # R / L = 8 mu / (rho r^2).
    return float(np.sqrt(8 * physics.viscosity / physics.density * values["L"] / values["R_poiseuille"]))


def shape_in_0d(shape: Shape, network: Network) -> Network:
    """Return the network with the shape in 0D, from which the 3D runs start so that few cycles suffice."""
    network, healthy = copy.deepcopy(network), healthy_radius(network, shape.place)
    values = network.vessel_values(shape.place)
    values["R_poiseuille"] *= float(np.mean(shape.radius(np.linspace(0.0, 1.0, 401)) ** -4.0))
    if shape.kind in STENOSES:
        values["stenosis_coefficient"] = stenosis_coefficient(STENOSES[shape.kind] ** 2, healthy, Physics())
    return network


def _domain(shape: Shape, network: Network) -> Domain:
    anatomy, radius = Anatomy(network), healthy_radius(network, shape.place)
    points, tets, faces = tube(LENGTH, lambda z: radius * shape.radius(z / LENGTH), RINGS, LEVELS)
    caps = []
    for name, location, flow in (
        ("inlet", anatomy.inlet(shape.place), "in"),
        ("outlet", anatomy.outlet(shape.place), "out"),
    ):
        upstream, downstream = location.split(":")
        couples = Couples(upstream=upstream, downstream=downstream, flow=flow)
        caps.append(Face(name=name, kind="cap", couples=couples))
    description = MeshDescription(faces=caps, replaces=[shape.place], regions={}, planes={})
    return Domain(points, tets, {n: faces[n] for n in ("inlet", "outlet")}, ["inlet"], {}, {}, description)


def _drop(shape: Shape, network: Network) -> tuple[str, str, str]:
    """Unknowns of the pressures at both ends of the 3D vessel, and of its flow."""
    anatomy = Anatomy(network)
    proximal, distal = anatomy.inlet(shape.place), anatomy.outlet(shape.place)
    return f"pressure:{proximal}", f"pressure:{distal}", f"flow:{distal}"


def _nearest(shape: Shape, case: make_case.Subject, waveforms: dict[str, dict]) -> tuple[Hypothesis, np.ndarray]:
    """Return the library effect that represents the shape, with the sizes z fitted to the 3D pressure drop.

    Least squares of drop = R Q + S |Q| Q + L dQ/dt over all conditions: S, and R in excess of the model's, for a
    stenosis; only that R for a narrowing.
    """
    anatomy, network = case.problem.forward.anatomy, case.problem.forward.network
    rows, drops = [], []
    for waves in waveforms.values():
        proximal, distal, flow = (waves[name][:-1] for name in _drop(shape, network))
        rate = (np.roll(flow, -1) - np.roll(flow, 1)) * len(flow) / (2.0 * anatomy.period)
        rows.append(np.stack([flow, flow * np.abs(flow), rate], axis=1))
        drops.append(proximal - distal)
    resistance, square, _ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(drops), rcond=None)[0]
    scale = anatomy.flow_scale(shape.place)
    hypothesis = Hypothesis(tuple(PlacedEffect(effect(name), shape.place) for name in shape.effects))
    if not hypothesis:
        return hypothesis, np.zeros(0)
    viscous = (resistance - network.vessel_values(shape.place)["R_poiseuille"]) * scale
    sizes: tuple[float, ...] = (square * scale**2 / anatomy.pressure, viscous / (square * scale**2))
    if shape.kind not in STENOSES:
        sizes = (viscous / anatomy.pressure,)
    parameters = hypothesis.effects[0].effect.parameters
    return hypothesis, np.array([float(p.to_standard(size)) for p, size in zip(parameters, sizes, strict=True)])
