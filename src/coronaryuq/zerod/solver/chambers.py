"""Chambers and valves as separate blocks, from which hearts are built; see `solver.elements` for the conventions.

Equations and names are those of svZeroDSolver's blocks (its developer documentation).
"""

from coronaryuq.zerod.network.numbering import Block
from coronaryuq.zerod.solver.activation import ACTIVATION
from coronaryuq.zerod.solver.assembly import Assembly, Context


def valve_tanh(block: Block, at: Context, system: Assembly) -> None:
    """Write a resistance that rises smoothly as the pressure turns adverse (Pfaller et al. 2019, eqs 16 and 22).

    P_in - P_out - (Rmin + (Rmax - Rmin) s) Q_in = 0,  Q_in - Q_out = 0,  s = (1 + tanh(k (P_out - P_in))) / 2,
    with k the steepness and s the unknown `valve_status`: 0 open, 1 closed.
    """
    (momentum, mass, status), (p_in, q_in, p_out, q_out, shut) = block.equations, block.variables
    rmin, rmax, steepness = at.values(block, "Rmin", "Rmax", "Steepness")
    gate = system.gate(p_in, p_out, steepness)
    _resistive_valve(momentum, mass, (p_in, q_in, p_out, q_out), rmin, rmax, gate, system)
    system.F(status, shut, 1.0)
    system.c_gate(status, -1.0, gate)


def piecewise_valve(block: Block, at: Context, system: Assembly) -> None:
    """Write a resistance Rmin while P_out < P_in and Rmax otherwise (Regazzoni et al. 2022, J. Comput. Phys. 457).

    P_in - P_out - R Q_in = 0,  Q_in - Q_out = 0: the limit of `valve_tanh` for infinite steepness.
    """
    (momentum, mass), (p_in, q_in, p_out, q_out) = block.equations, block.variables
    rmin, rmax = at.values(block, "Rmin", "Rmax")
    gate = system.gate(p_in, p_out, 0.0)
    _resistive_valve(momentum, mass, (p_in, q_in, p_out, q_out), rmin, rmax, gate, system)


def _resistive_valve(momentum, mass, ends, rmin, rmax, gate, system: Assembly) -> None:
    p_in, q_in, p_out, q_out = ends
    system.F(momentum, p_in, 1.0)
    system.F(momentum, p_out, -1.0)
    system.F(momentum, q_in, -rmin)
    system.F_gate(momentum, q_in, rmin - rmax, gate)
    system.F(mass, q_in, 1.0)
    system.F(mass, q_out, -1.0)


def linear_elastance_chamber(block: Block, at: Context, system: Assembly) -> None:
    """Write a chamber of varying elastance, one pressure at both ends (Regazzoni et al. 2022, J. Comput. Phys. 457).

    P_in - E(t) (V - Vrest) = 0,  P_in - P_out = 0,  Q_in - Q_out - dV/dt = 0,  E = Epass + Emax A(t).
    """
    elastance, momentum, mass = block.equations
    p_in, _, p_out, _, v = block.variables
    emax, epass, vrest = (value[:, None] for value in at.values(block, "Emax", "Epass", "Vrest"))
    varying = epass + emax * ACTIVATION[block.activation](block, at)
    system.F(elastance, p_in, 1.0)
    system.F_time(elastance, v, -1.0, varying)
    system.c_time(elastance, 1.0, varying * vrest)
    system.F(momentum, p_in, 1.0)
    system.F(momentum, p_out, -1.0)
    _volume(block, mass, system)


def chamber_elastance_inductor(block: Block, at: Context, system: Assembly) -> None:
    """Write a chamber of varying elastance and resting volume, with an inertance (Kerckhoffs et al. 2007, eqs 1, 2).

    P_in - E(t) (V - Vrest(t)) = 0,  P_in - P_out - L dQ_out/dt = 0,  Q_in - Q_out - dV/dt = 0, with L the impedance,
    E = Emin + (Emax - Emin) A(t) and Vrest = Vrs + (Vrd - Vrs) (1 - A(t)).
    """
    elastance, momentum, mass = block.equations
    p_in, _, _, _, v = block.variables
    emax, emin, vrd, vrs = (value[:, None] for value in at.values(block, "Emax", "Emin", "Vrd", "Vrs"))
    active = ACTIVATION[block.activation](block, at)
    varying = (emax - emin) * active + emin
    system.F(elastance, p_in, 1.0)
    system.F_time(elastance, v, -1.0, varying)
    system.c_time(elastance, 1.0, varying * ((1.0 - active) * (vrd - vrs) + vrs))
    _inertance(block, momentum, at, system)
    _volume(block, mass, system)


def chamber_elastance_inductor_exponential(block: Block, at: Context, system: Assembly) -> None:
    """Write a chamber with an exponential passive curve and an inertance: an atrium (Sankaran et al. 2012).

    P_in - A(t) Emax (V - Vaso) - (1 - A(t)) Kxp (exp(Kxv (V - Vaso)) - 1) = 0; the other two equations are those of
    `chamber_elastance_inductor`.
    """
    elastance, momentum, mass = block.equations
    p_in, _, _, _, v = block.variables
    emax, kxp, kxv, vaso = at.values(block, "Emax", "Kxp", "Kxv", "Vaso")
    active = ACTIVATION[block.activation](block, at)
    system.F(elastance, p_in, 1.0)
    system.F_time(elastance, v, -emax, active)
    system.c_time(elastance, emax * vaso, active)
    system.exponential(elastance, v, kxp, kxv, vaso, active - 1.0)
    _inertance(block, momentum, at, system)
    _volume(block, mass, system)


def _inertance(block: Block, row: int, at: Context, system: Assembly) -> None:
    p_in, _, p_out, q_out, _ = block.variables
    (inertance,) = at.values(block, "Impedance")
    system.F(row, p_in, 1.0)
    system.F(row, p_out, -1.0)
    system.E(row, q_out, -inertance)


def _volume(block: Block, row: int, system: Assembly) -> None:
    _, q_in, _, q_out, v = block.variables
    system.F(row, q_in, 1.0)
    system.F(row, q_out, -1.0)
    system.E(row, v, -1.0)
