"""A 0D network from a centreline tree, by the published rules (Pfaller et al. 2022), as svZeroDSolver JSON in CGS."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel, area_ratio
from coronaryuq.case.network.entrances import kinetic_coefficient
from coronaryuq.case.network.network import AFTER_HEART, BEFORE_HEART, ENTRANCE, HEART_TYPE, Network
from coronaryuq.case.network.network import HEART as HEART_BLOCK
from coronaryuq.case.settings import (
    CORONARY_SHARE,
    KINETIC_FACTOR,
    MURRAY_EXPONENT,
    STENOSIS_LOSS,
    THICKNESS_RATIO,
    YOUNG,
)
from coronaryuq.core.units import BLOOD_DENSITY, BLOOD_VISCOSITY, MMHG

RADIUS_STEP = 0.1
"""Largest distance (cm) of the radii of a 0D vessel that its entry in the network lists."""
CORONARY_SHARES = {"Ra": 0.32, "Ram": 0.52, "Rv": 0.16}
"""Fractions of a coronary bed's resistance (Kim et al. 2010)."""
CORONARY_CAPACITANCE = {
    "ClosedLoopCoronaryLeft": {"Ca": 0.000552427 / MMHG, "Cim": 0.003737025 / MMHG},
    "ClosedLoopCoronaryRight": {"Ca": 0.001055957 / MMHG, "Cim": 0.003463134 / MMHG},
}
"""cm5/dyn, all left and all right beds together: svZeroDSolver's case closedLoopHeart_withCoronaries."""
PROXIMAL_SHARE = 0.09
"""Rp / (Rp + Rd) of the systemic outlets, as in that case."""
SYSTEMIC_CAPACITANCE = 0.292498360 / MMHG
"""cm5/dyn, all systemic outlets together, as in that case."""

_PRESSURE_LIKE = (
    "Erv_s", "Elv_s", "Lrv_a", "Rrv_a", "Lra_v", "Rra_v", "Lla_v", "Rla_v", "Rlv_ao", "Llv_a", "Rpd", "Kxp_ra",
    "Emax_ra", "Kxp_la", "Emax_la",
)  # fmt: skip
_CAPACITANCES = ("Cp", "Cpa")
_HEART_MMHG = {
    "Tsa": 0.40742, "tpwave": 8.976868, "Erv_s": 2.125279, "Elv_s": 3.125202, "iml": 0.509365, "imr": 0.806369,
    "Lrv_a": 0.000186865, "Rrv_a": 0.035061704, "Lra_v": 0.000217032, "Rra_v": 0.007887459, "Lla_v": 0.000351787,
    "Rla_v": 0.005310825, "Rlv_ao": 0.034320234, "Llv_a": 0.000110776, "Vrv_u": 9.424629, "Vlv_u": 5.606007,
    "Rpd": 0.098865401, "Cp": 1.090989, "Cpa": 0.556854, "Kxp_ra": 9.22244, "Kxv_ra": 0.004837, "Emax_ra": 0.208858,
    "Vaso_ra": 4.848742, "Kxp_la": 9.194992, "Kxv_la": 0.008067, "Emax_la": 0.303119, "Vaso_la": 9.355754,
}  # fmt: skip
"""svZeroDSolver's case closedLoopHeart_withCoronaries, in mmHg and mL."""

HEART = {
    name: value * MMHG if name in _PRESSURE_LIKE else value / MMHG if name in _CAPACITANCES else value
    for name, value in _HEART_MMHG.items()
}
"""Heart and pulmonary parameters to start from, CGS: pressures, elastances, resistances and inductances times 1333.22,
capacitances divided by it; times, volumes, 1/volumes and the intramyocardial fractions (iml, imr) unchanged."""


@dataclass(frozen=True)
class Bed:
    """A coronary outlet: its boundary condition, the tree vessel that ends there, and the coronary block's type."""

    name: str
    vessel: str
    right: bool

    @property
    def type(self) -> str:
        return "ClosedLoopCoronaryRight" if self.right else "ClosedLoopCoronaryLeft"


@dataclass(frozen=True)
class Physics:
    """Parameters of the rules other than the tree; defaults are the paper's blood, rigid walls and resting flow.

    kinetic_factor: α of the pressure α ρ v̄²/2 that speeds the blood up where an artery leaves the aorta.
    elastic: give vessels C = 3 π L r̄³ / (2 E h) with h = thickness_ratio · r̄; rigid walls have C = 0 (paper, 2.2).
    pressure (dyn/cm2), cardiac_output (mL/s), coronary_share: the resting state that initial resistances produce.
    """

    density: float = BLOOD_DENSITY
    viscosity: float = BLOOD_VISCOSITY
    stenosis_loss: float = STENOSIS_LOSS
    kinetic_factor: float = KINETIC_FACTOR
    elastic: bool = False
    young: float = YOUNG
    thickness_ratio: float = THICKNESS_RATIO
    murray_exponent: float = MURRAY_EXPONENT
    pressure: float = 93.0 * MMHG
    cardiac_output: float = 5000.0 / 60.0
    coronary_share: float = CORONARY_SHARE
    period: float = 1.0
    heart: Mapping[str, float] = field(default_factory=lambda: dict(HEART))


@dataclass(frozen=True)
class Segment:
    """One 0D vessel: part of a tree vessel between two arc lengths (cm); `stenosis` is its name if it is one."""

    name: str
    vessel: str
    start: float
    end: float
    stenosis: str | None = None


def segments(
    tree: Tree, stenoses: Sequence[Stenosis], beds: Collection[str] = (), shortest: float = 0.02
) -> list[Segment]:
    """Return the 0D vessels of a tree, parents first: one per vessel, cut at ends of stenoses and where FFR is read.

    Inner vessels become `NAME_seg0`, `NAME_seg1`, ...; the last part of a vessel that ends the tree, or of the aortic
    root, keeps the plain name unless a boundary condition or the heart has it. An ostial artery starts where it leaves
    the aorta.

    Parameters
    ----------
    tree : Tree
        Vessels, cm.
    stenoses : sequence of Stenosis
        Where to cut.
    beds : collection of str
        Boundary conditions of the network, whose names no vessel may have.
    shortest : float
        Length (cm) below which a part next to a stenosis is left out.

    Raises
    ------
    ValueError
        If a stenosis lies outside its vessel, or two overlap.
    """
    taken = {HEART_BLOCK, BEFORE_HEART, AFTER_HEART, *beds}
    ends = ({v.name for v in tree.leaves()} | {tree.root.name}) - taken
    taken |= ends
    result = []
    for vessel in tree:
        here = sorted((s for s in stenoses if s.vessel == vessel.name), key=lambda s: s.start)
        begin = tree.emergence(vessel.name)
        parts: list[tuple[float, float, str | None]] = []
        for stenosis in here:
            if stenosis.start < begin - 1e-6 or stenosis.end > vessel.length + 1e-6 or stenosis.end <= stenosis.start:
                raise ValueError(
                    f"stenosis {stenosis.name}: {stenosis.start:.3g} to {stenosis.end:.3g} cm does not fit between "
                    f"{begin:.3g} and {vessel.length:.3g} cm of vessel {vessel.name}, or overlaps another stenosis"
                )
            if stenosis.start - begin > shortest:
                parts.append((begin, stenosis.start, None))
            parts.append((stenosis.start, min(stenosis.end, vessel.length), stenosis.name))
            begin = stenosis.end
            room = min((other.start for other in here if other.start > stenosis.start), default=vessel.length)
            if (read := stenosis.read) and read.arc - begin > shortest and room - read.arc > shortest:
                parts.append((begin, read.arc, None))
                begin = read.arc
        if vessel.length - begin > shortest or not parts:
            parts.append((begin, vessel.length, None))
        for k, (start, end, name) in enumerate(parts):
            plain = vessel.name in ends and k == len(parts) - 1
            own = vessel.name if plain else _free(vessel.name, f"_seg{k}", taken)
            result.append(Segment(own, vessel.name, start, end, name))
    return result


def _free(stem: str, ending: str, taken: set[str]) -> str:
    """Return a name that no block has yet, with as few underscores between stem and ending as possible, and take it."""
    while (name := stem + ending) in taken:
        stem += "_"
    taken.add(name)
    return name


def shape_integrals(radii: np.ndarray, arc: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ∫ r⁻⁴ ds (cm⁻³), ∫ r⁻² ds (cm⁻¹) and the mean radius (cm), exact for radii linear between points.

    radii: (..., n) cm; arc: (n,) cm; results: (...).
    """
    fourth, second, first = shape_integrands(radii, np.diff(arc))
    return fourth.sum(axis=-1), second.sum(axis=-1), first.sum(axis=-1) / (arc[-1] - arc[0])


def shape_integrands(radii: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ∫ r⁻⁴ ds (cm⁻³), ∫ r⁻² ds (cm⁻¹) and ∫ r ds (cm²) of each interval, exact for radii linear in it.

    radii: (..., n) cm; step: (n - 1,) cm; results: (..., n - 1).
    """
    a, b = radii[..., :-1], radii[..., 1:]
    return step * (a**2 + a * b + b**2) / (3 * a**3 * b**3), step / (a * b), step * (a + b) / 2


def elements(vessel: Vessel, physics: Physics) -> dict[str, float]:
    """Compute R, L and C of a part of a vessel in laminar flow (Pfaller et al. 2022, Eqs. 4 to 6), CGS.

    R = 8 µ/π ∫ r⁻⁴ ds and L = ρ/π ∫ r⁻² ds, exact for radii that are linear between points; for a constant radius they
    are the published 8 µ l/(π r⁴) and ρ l/(π r²).
    """
    fourth, second, mean = shape_integrals(vessel.radii, vessel.arc)
    if physics.elastic:
        capacitance = 3 * np.pi * vessel.length * float(mean) ** 2 / (2 * physics.young * physics.thickness_ratio)
    else:
        capacitance = 0.0
    return {
        "R_poiseuille": float(8 * physics.viscosity / np.pi * fourth),
        "L": float(physics.density / np.pi * second),
        "C": float(capacitance),
        "stenosis_coefficient": 0.0,
    }


def stenosis_coefficient(ratio: float, healthy_radius: float, physics: Physics) -> float:
    """Compute S of ΔP = S |Q| Q, CGS: K_t ρ / (2 A_0²) (A_0/A_s − 1)² (Pfaller et al. 2022, Eq. 7).

    ratio: A_s/A_0. healthy_radius: cm.
    """
    area = np.pi * healthy_radius**2
    return float(physics.stenosis_loss * physics.density / (2 * area**2) * (1 / ratio - 1) ** 2)


def network_from_tree(
    tree: Tree,
    beds: Sequence[Bed],
    systemic: Mapping[str, str],
    stenoses: Sequence[Stenosis] = (),
    physics: Physics | None = None,
) -> Network:
    """Build the closed loop: heart `CLH`, vessels, junctions, coronary beds and systemic Windkessels.

    Resistances and capacitances divide the resting flow among outlets by Murray's law.

    Parameters
    ----------
    tree : Tree
        Vessels, cm.
    beds : sequence of Bed
        One per coronary end of the tree.
    systemic : mapping of str to str
        Boundary condition → aortic end of the tree.
    stenoses : sequence of Stenosis
        Stenoses of the tree.
    physics : Physics, optional
        Blood, walls and resting state.

    Returns
    -------
    Network
        svZeroDSolver JSON, CGS.

    Raises
    ------
    ValueError
        If an end of the tree has no outlet, or an outlet no end.
    """
    physics = physics or Physics()
    ends = {v.name for v in tree.leaves()}
    with_outlet = [b.vessel for b in beds] + list(systemic.values())
    if sorted(with_outlet) != sorted(ends):
        raise ValueError(
            f"ends of the tree without an outlet: {', '.join(sorted(ends - set(with_outlet))) or 'none'}; "
            f"outlets at no end of the tree: {', '.join(sorted(set(with_outlet) - ends)) or 'none'}"
        )
    bed_names = [b.name for b in beds] + list(systemic)
    parts = segments(tree, stenoses, bed_names)
    number = {part.name: k for k, part in enumerate(parts)}
    at_end = {b.vessel: b.name for b in beds} | {vessel: name for name, vessel in systemic.items()}
    by_name = {s.name: s for s in stenoses}
    vessels = []
    for part in parts:
        values = elements(tree[part.vessel].between(part.start, part.end), physics)
        if part.stenosis is not None:
            stenosis = by_name[part.stenosis]
            healthy = float(tree[part.vessel].radius_at(part.start))
            values["stenosis_coefficient"] = stenosis_coefficient(area_ratio(tree, stenosis), healthy, physics)
        entrance = 0.0
        if physics.kinetic_factor and tree.ostial(tree[part.vessel]) and part is _first(parts, part):
            added = kinetic_coefficient(tree, part.vessel, physics.kinetic_factor, physics.density)
            values["stenosis_coefficient"] += added
            entrance = added / values["stenosis_coefficient"]
        block: dict = {
            "vessel_id": number[part.name],
            "vessel_name": part.name,
            "vessel_length": part.end - part.start,
            "zero_d_element_type": "BloodVessel",
            "zero_d_element_values": values,
            "radii": _even_radii(tree[part.vessel].between(part.start, part.end)),
        }
        if entrance:
            block[ENTRANCE] = entrance
        if part.vessel in at_end and _is_last(parts, part):
            block["boundary_conditions"] = {"outlet": at_end[part.vessel]}
        vessels.append(block)
    mean = physics.pressure
    network = {
        "simulation_parameters": {
            "number_of_cardiac_cycles": 6,
            "number_of_time_pts_per_cardiac_cycle": 1000,
            "steady_initial": False,
            "output_variable_based": True,
            "output_all_cycles": False,
        },
        "boundary_conditions": [*_windkessels(tree, systemic, physics), *_coronary_beds(tree, beds, physics)],
        "vessels": vessels,
        "junctions": _junctions(tree, parts, number, {*number, *bed_names}),
        "closed_loop_blocks": [
            {
                "closed_loop_type": HEART_TYPE,
                "outlet_blocks": [parts[0].name],
                "cardiac_cycle_period": physics.period,
                "parameters": dict(physics.heart),
            }
        ],
        "initial_condition": {
            "V_RA:CLH": 38.43,
            "V_RV:CLH": 96.07,
            "V_LA:CLH": 38.43,
            "V_LV:CLH": 96.07,
            "P_pul:CLH": 8.0 * MMHG,
            "pressure_all": 0.75 * mean,
        },
    }
    return Network(network)


def _even_radii(vessel: Vessel) -> list[float]:
    """Return radii (cm) at even distances of at most `RADIUS_STEP`, for the course of the pressure within a 0D vessel.

    svZeroDSolver ignores them.
    """
    count = max(2, int(np.ceil(vessel.length / RADIUS_STEP)) + 1)
    radii = np.interp(np.linspace(0.0, vessel.length, count), vessel.arc - vessel.arc[0], vessel.radii)
    return [float(f"{radius:.5g}") for radius in radii]


def _first(parts: Sequence[Segment], part: Segment) -> Segment:
    return next(p for p in parts if p.vessel == part.vessel)


def _is_last(parts: Sequence[Segment], part: Segment) -> bool:
    return part is [p for p in parts if p.vessel == part.vessel][-1]


def _junctions(tree: Tree, parts: Sequence[Segment], number: Mapping[str, int], taken: set[str]) -> list[dict]:
    junctions: list[dict] = []
    for k, part in enumerate(parts):
        if k + 1 < len(parts) and parts[k + 1].vessel == part.vessel:
            after = [parts[k + 1].name]
        else:
            after = [
                next(p.name for p in parts if p.vessel == child.name)
                for child in tree.children(part.vessel)
            ]  # fmt: skip
        if after:
            junctions.append(
                {
                    "junction_name": _free(f"J{len(junctions)}", "", taken),
                    "junction_type": "NORMAL_JUNCTION",
                    "inlet_vessels": [number[part.name]],
                    "outlet_vessels": [number[name] for name in after],
                }
            )
    return junctions


def murray_shares(radii, exponent: float = MURRAY_EXPONENT) -> np.ndarray:
    """Return the fraction of flow (n,) of outlets with radii (n,), proportional to radius**exponent."""
    weights = np.asarray(radii, dtype=float) ** exponent
    return weights / weights.sum()


def _coronary_beds(tree: Tree, beds: Sequence[Bed], physics: Physics) -> list[dict]:
    if not beds:
        return []
    flow = physics.cardiac_output * physics.coronary_share
    shares = murray_shares([tree[b.vessel].radii[-1] for b in beds], physics.murray_exponent)
    blocks = []
    for bed, share in zip(beds, shares, strict=True):
        side = shares[[b.right == bed.right for b in beds]].sum()
        resistance = physics.pressure / (flow * share)
        values = {name: resistance * part for name, part in CORONARY_SHARES.items()}
        values |= {name: total * share / side for name, total in CORONARY_CAPACITANCE[bed.type].items()}
        blocks.append({"bc_name": bed.name, "bc_type": bed.type, "bc_values": {k: float(v) for k, v in values.items()}})
    return blocks


def _windkessels(tree: Tree, systemic: Mapping[str, str], physics: Physics) -> list[dict]:
    flow = physics.cardiac_output * (1 - physics.coronary_share)
    shares = murray_shares([tree[v].radii[-1] for v in systemic.values()], physics.murray_exponent)
    blocks = []
    for name, share in zip(systemic, shares, strict=True):
        resistance = physics.pressure / (flow * share)
        values = {
            "Rp": float(PROXIMAL_SHARE * resistance),
            "Rd": float((1 - PROXIMAL_SHARE) * resistance),
            "C": float(SYSTEMIC_CAPACITANCE * share),
            "closed_loop_outlet": True,
        }
        blocks.append({"bc_name": name, "bc_type": "ClosedLoopRCR", "bc_values": values})
    return blocks
