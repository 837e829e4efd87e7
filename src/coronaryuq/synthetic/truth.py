"""A synthetic patient's true state: a closed loop at rest and under hyperaemia, and the resulting perfusion."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from coronaryuq.case.network.build import Bed, Physics, murray_shares, network_from_tree, segments
from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology
from coronaryuq.core import seeds
from coronaryuq.core.units import MBF_PER_MIN_PER_G, MMHG, TISSUE_DENSITY
from coronaryuq.synthetic.anatomy import Anatomy, patient_anatomy
from coronaryuq.synthetic.perfusion_map import perfusion_map, territories, texture
from coronaryuq.synthetic.settings import Settings
from coronaryuq.zerod.cardiac_function import measure, waveform_names
from coronaryuq.zerod.network.beds import resistance_changes
from coronaryuq.zerod.network.changes import with_changes
from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.periodic import Periodicity
from coronaryuq.zerod.solver.result import Result

if TYPE_CHECKING:
    import pyvista

SYSTEMIC = "BC_RCR1"
RIGHT_ATRIUM = "V_RA:CLH"

HEART = {
    "Tsa": 0.41, "tpwave": 8.9, "Erv_s": 2.2 * MMHG, "Elv_s": 3.2 * MMHG, "iml": 0.9, "imr": 0.9,
    "Lra_v": 0.3, "Rra_v": 10.0, "Lrv_a": 0.35, "Rrv_a": 46.0, "Lla_v": 0.45, "Rla_v": 8.0, "Llv_a": 0.2,
    "Rlv_ao": 33.0, "Vrv_u": -2.0, "Vlv_u": -3.0, "Rpd": 80.0, "Cp": 1.1 / MMHG, "Cpa": 0.45 / MMHG,
    "Kxp_ra": 8.6 * MMHG, "Kxv_ra": 0.0045, "Emax_ra": 0.33 * MMHG, "Vaso_ra": 3.0,
    "Kxp_la": 8.2 * MMHG, "Kxv_la": 0.0080, "Emax_la": 0.32 * MMHG, "Vaso_la": 7.0,
}  # fmt: skip
"""Heart, valves and lungs in CGS: within the ranges of Tran et al. (2017), but not at their centres."""

SYSTEMIC_COMPLIANCE = 0.75 / MMHG
"""cm5/dyn; with the proximal aorta's it makes a pulse pressure of about 50 mmHg."""

ARTERIAL_TIME, MYOCARDIAL_TIME = 0.05, 3.0
"""s: total resistance of a coronary side at rest times its arterial and its intramyocardial compliance."""

FILLING = 300.0
"""mL of blood that increase stroke volume about e-fold; affects only the convergence of the fixed-point iteration."""

SWEEPS, TOLERANCE = 40, 2e-4
STEPS, PERIODIC = 500, 1e-4


@dataclass(frozen=True)
class State:
    """The loop in one condition: network with a periodic initial state, mean flow per bed, FFR, measures; all CGS."""

    network: Network
    flows: dict[str, float]
    ffr: dict[str, float]
    measures: dict[str, float]


@dataclass(frozen=True)
class Patient:
    """Anatomy, wall (pyvista grid with cell data MBF in mL/min/g), true states, and mass (g) per LV bed."""

    anatomy: Anatomy
    wall: "pyvista.UnstructuredGrid"
    rest: State
    hyperaemia: State
    masses: dict[str, float]
    settings: Settings


def bed_name(vessel: str) -> str:
    """Return the boundary condition of the outlet that ends this vessel, by the case stage's default."""
    return f"BC_{vessel}"


def make_patient(settings: Settings, seed: int) -> Patient:
    """Make the bundled patient; over each territory the perfusion map integrates to that outlet's flow exactly."""
    return patient_of(patient_anatomy(settings.anatomy_seed), settings, seed)


def patient_of(anatomy: Anatomy, settings: Settings, seed: int, physics: Physics | None = None) -> Patient:
    """Make the patient of an anatomy.

    Parameters
    ----------
    anatomy
        Vessels and heart.
    settings, seed
        Of the patient.
    physics
        Blood, heart and Murray's exponent, if they are not the bundled patient's; the rest follows from the settings.

    Raises
    ------
    ValueError, RuntimeError
        If the settings contradict one another.
    """
    masses = _Perfused.of(anatomy, settings).bed_masses
    rest, hyperaemia = _Loop(anatomy, masses, settings, _network(anatomy, masses, settings, seed, physics)).solve()
    return _with_map(anatomy, rest, hyperaemia, settings, seed)


def with_vessels(patient: Patient, values: Mapping[str, Mapping[str, float]], seed: int) -> Patient:
    """Return the patient with other element values of some 0D vessels, in its periodic states and perfusion with them.

    values: vessel → element → value, CGS. The heart, the blood volume and all beds stay.
    """

    def changed(state: State) -> State:
        network = state.network.deep_copy()
        for vessel, elements in values.items():
            network.vessel_values(vessel).update(elements)
        return _Loop(patient.anatomy, patient.masses, patient.settings, network).state()

    return _with_map(patient.anatomy, changed(patient.rest), changed(patient.hyperaemia), patient.settings, seed)


@dataclass(frozen=True)
class _Perfused:
    """The wall, its cells' centres (n, 3) cm and volumes (n,) cm3, and the mass of each territory, g."""

    wall: "pyvista.UnstructuredGrid"
    centres: np.ndarray
    volumes: np.ndarray
    ends: np.ndarray
    bed_masses: dict[str, float]

    @classmethod
    def of(cls, anatomy: Anatomy, settings: Settings) -> "_Perfused":
        wall = anatomy.wall(settings.cells)
        centres = np.asarray(wall.cell_centers().points, float)
        volumes = np.abs(np.asarray(wall.compute_cell_sizes(length=False, area=False)["Volume"], float))
        feeding = [outlet for outlet in anatomy.outlets if outlet.perfuses == "LV"]
        ends = np.array([anatomy.tree[outlet.vessel].points[-1] for outlet in feeding])
        territory = territories(centres, ends)
        masses = np.bincount(territory, weights=volumes, minlength=len(feeding)) * TISSUE_DENSITY
        of_bed = {bed_name(o.vessel): float(m) for o, m in zip(feeding, masses, strict=True)}
        return cls(wall, centres, volumes, ends, of_bed)


def _with_map(anatomy: Anatomy, rest: State, hyperaemia: State, settings: Settings, seed: int) -> Patient:
    perfused = _Perfused.of(anatomy, settings)
    flows = np.array([hyperaemia.flows[bed] for bed in perfused.bed_masses])
    pattern = texture(perfused.centres, settings.texture, settings.texture_length, seed)
    masses = perfused.volumes * TISSUE_DENSITY
    perfusion = perfusion_map(perfused.centres, masses, perfused.ends, flows, pattern)
    perfused.wall.cell_data["MBF"] = perfusion / MBF_PER_MIN_PER_G
    return Patient(anatomy, perfused.wall, rest, hyperaemia, perfused.bed_masses, settings)


class _Loop:
    """The closed loop, whose systemic resistance, coronary resistance and blood volume follow from the settings."""

    def __init__(self, anatomy: Anatomy, masses: Mapping[str, float], settings: Settings, network: Network):
        self.settings, self.masses = settings, masses
        self.network = network
        self.engine = Engine(self.network)
        self.blood = BloodVolume(self.engine.model)
        self.right_atrium = self.engine.model.index[RIGHT_ATRIUM]
        self.roles = waveform_names(self.network)
        ends = Topology(self.network).vessel_of
        self.beds = {bed: vessel for bed, vessel in ends.items() if bed != SYSTEMIC}
        stenosed = {part.stenosis: part.name for part in segments(anatomy.tree, anatomy.stenoses) if part.stenosis}
        self.distal = {
            artery: next(name for name in self.engine.unknowns if name.startswith(f"pressure:{vessel}:"))
            for artery, vessel in stenosed.items()
        }

    def state(self) -> State:
        """Return the periodic state of the network as it is, from its own initial condition."""
        return self._state(self.network, self._run(self.network, None))

    def solve(self) -> tuple[State, State]:
        """Solve for the mean pressure, stroke volume at rest and mean hyperaemic perfusion of the settings."""
        wanted_flow = self.settings.mbf * MBF_PER_MIN_PER_G * sum(self.masses.values())
        rest = hyper = None
        for _ in range(SWEEPS):
            relaxed = hyperaemic(self.network, self.settings.hyperaemia)
            rest = self._run(self.network, rest)
            if hyper is None:
                hyper = rest
            # Both conditions have the same blood volume.
            hyper.state[:, self.right_atrium] += self._blood(self.network, rest) - self._blood(relaxed, hyper)
            hyper = self._run(relaxed, hyper)
            measures = self._measures(rest)
            pressure = measures["PaoMean"] / (self.settings.mean_pressure * MMHG)
            stroke = measures["AbsQin"] / self.settings.stroke_volume
            flow = sum(self._flow(hyper, bed) for bed in self.masses) / wanted_flow
            if max(abs(pressure - 1.0), abs(stroke - 1.0), abs(flow - 1.0)) < TOLERANCE:
                return self._state(self.network, rest), self._state(relaxed, hyper)
            # Pressure depends on resistance times output, output on filling, perfusion on coronary resistance.
            _scale(self.network, systemic=stroke / pressure, coronary=flow)
            rest.state[:, self.right_atrium] -= FILLING * np.log(stroke)
        raise RuntimeError("the patient's loop does not converge; its settings contradict one another")

    def _run(self, network: Network, previous: Result | None) -> Result:
        waves = [name for names in self.roles.values() for name in names]
        means = [f"mean_{name}" for name in [*self._flow_names().values(), *self.distal.values()]]
        result = self.engine.run_to_periodic(
            bed_values(network),
            quantities=[*means, f"mean_{self.roles['aortic_pressure'][0]}"],
            waveforms=waves,
            periodicity=Periodicity(tolerance=PERIODIC),
            steps_per_cycle=STEPS,
            start=None if previous is None else previous.state,
        )
        if not result.ok.all():
            raise RuntimeError(f"the patient's loop has no periodic state: {result.status[0]}")
        return result

    def _flow_names(self) -> dict[str, str]:
        return {bed: f"flow:{vessel}:{bed}" for bed, vessel in self.beds.items()}

    def _flow(self, result: Result, bed: str) -> float:
        return float(result.values[f"mean_{self._flow_names()[bed]}"][0])

    def _blood(self, network: Network, result: Result) -> np.ndarray:
        return self.blood.evaluate(result.state, bed_values(network))

    def _measures(self, result: Result) -> dict[str, float]:
        waves = {role: np.asarray(sum(result.waveforms[name] for name in names)) for role, names in self.roles.items()}
        return {name: float(value[0]) for name, value in measure(result.time, waves).items()}

    def _state(self, network: Network, result: Result) -> State:
        network = network.deep_copy()
        network["initial_condition"] = {
            name: float(value) for name, value in zip(self.engine.unknowns, result.state[0], strict=False)
        }
        aorta = float(result.values[f"mean_{self.roles['aortic_pressure'][0]}"][0])
        ffr = {artery: float(result.values[f"mean_{name}"][0]) / aorta for artery, name in self.distal.items()}
        flows = {bed: self._flow(result, bed) for bed in self.beds}
        return State(network, flows, ffr, self._measures(result))


def _network(
    anatomy: Anatomy, masses: Mapping[str, float], settings: Settings, seed: int, physics: Physics | None
) -> Network:
    """Build the loop before its totals are set: random conductance per mass of LV beds, the rest by Murray's law.

    Murray's law over all outlets sets the total of the LV-perfusing beds, as the method assumes (paper, 2.3).
    """
    names = [bed_name(outlet.vessel) for outlet in anatomy.outlets]
    right = [outlet.branch == "RCA" for outlet in anatomy.outlets]
    physics = replace(
        physics or Physics(heart=dict(HEART)),
        pressure=settings.mean_pressure * MMHG,
        cardiac_output=settings.stroke_volume / settings.period,
        period=settings.period,
    )
    beds = [Bed(name, o.vessel, side) for name, o, side in zip(names, anatomy.outlets, right, strict=True)]
    network = network_from_tree(anatomy.tree, beds, {SYSTEMIC: "aorta_outlet"}, anatomy.stenoses, physics)
    radii = [anatomy.tree[outlet.vessel].radii[-1] for outlet in anatomy.outlets]
    by_radius = murray_shares(radii, physics.murray_exponent)
    random_factors = np.exp(settings.bed_spread * seeds.generator(seed, "patient", "beds").standard_normal(len(names)))
    microvascular: Mapping[str, float] = {str(artery): value for artery, value in settings.microvascular.items()}
    disease = [microvascular.get(outlet.branch, 1.0) for outlet in anatomy.outlets]
    weights = {
        name: masses.get(name, 0.0) * factor * conductance
        for name, factor, conductance in zip(names, random_factors, disease, strict=True)
    }
    lv_share = sum(share for name, share in zip(names, by_radius, strict=True) if name in masses)
    total = physics.pressure / (physics.cardiac_output * physics.coronary_share)
    for bc in network.boundary_conditions:
        values = bc["bc_values"]
        if bc["bc_name"] == SYSTEMIC:
            values["C"] = SYSTEMIC_COMPLIANCE
            continue
        name = bc["bc_name"]
        share = by_radius[names.index(name)]
        if name in masses:
            share = lv_share * weights[name] / sum(weights.values())
        resistance = total / float(share)
        arterial = resistance * (1.0 - settings.venous_share)
        # Ra to Ram as in Kim et al. (2010): 0.32 to 0.52.
        values |= {"Ra": arterial * 0.32 / 0.84, "Ram": arterial * 0.52 / 0.84, "Rv": resistance - arterial}
        values |= {"Ca": ARTERIAL_TIME / resistance, "Cim": MYOCARDIAL_TIME / resistance}
    return network


def _scale(network: Network, systemic: float, coronary: float) -> None:
    """Multiply total resistances in place; a coronary bed keeps its time constants."""
    for bc in network.boundary_conditions:
        values = bc["bc_values"]
        if bc["bc_name"] == SYSTEMIC:
            values["Rp"], values["Rd"] = values["Rp"] * systemic, values["Rd"] * systemic
        else:
            for member in ("Ra", "Ram", "Rv"):
                values[member] *= coronary
            for member in ("Ca", "Cim"):
                values[member] /= coronary


def hyperaemic(network: Network, scale: float) -> Network:
    """Return a copy with Ra and Ram of every coronary bed times `scale` (paper, section 2.2)."""
    changes = resistance_changes(network, hyperaemia=scale)
    return with_changes(network, {name: float(value) for name, value in changes.items()})


def bed_values(network: Network) -> dict[str, float]:
    """Return all bed parameters as changes for the engine."""
    return {
        f"{bc['bc_name']}.{member}": value
        for bc in network.boundary_conditions
        for member, value in bc["bc_values"].items()
        if not isinstance(value, bool)
    }
