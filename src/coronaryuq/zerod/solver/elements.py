"""The equations of each 0D element.

Each function writes one block into an `Assembly`: E ẏ + F y + c(y, ẏ, t) = 0, the form and sign of svZeroDSolver's
documentation, whose elements these are (Menon et al., "svZeroDSolver: a modular package for lumped-parameter
cardiovascular simulations", JOSS 2025, and the developer documentation of each block). Parameters are arrays over the
samples of a batch, so one call serves them all.
"""

from collections.abc import Callable

import numpy as np

from coronaryuq.zerod.network.numbering import Block
from coronaryuq.zerod.solver import chambers
from coronaryuq.zerod.solver.assembly import Assembly, Context

Write = Callable[[Block, Context, Assembly], None]


def blood_vessel(block: Block, at: Context, system: Assembly) -> None:
    """Write a vessel: resistance, stenosis and inertance in series, compliance behind the resistance.

    P_in − P_out − (R + S|Q_in|) Q_in − L dQ_out/dt = 0,  Q_in − Q_out − C dP_in/dt + C (R + 2S|Q_in|) dQ_in/dt = 0.
    Our extension: a resistance R_wall in series with the compliance, which adds C R_wall d(Q_in − Q_out)/dt to the
    second equation (Kelvin-Voigt); it is zero unless given in the network.
    """
    (momentum, mass), (p_in, q_in, p_out, q_out) = block.equations, block.variables
    r, c, l, s, wall = at.values(block, "R_poiseuille", "C", "L", "stenosis_coefficient", "R_wall")
    system.F(momentum, p_in, 1.0)
    system.F(momentum, q_in, -r)
    system.F(momentum, p_out, -1.0)
    system.E(momentum, q_out, -l)
    system.F(mass, q_in, 1.0)
    system.F(mass, q_out, -1.0)
    system.E(mass, p_in, -c)
    system.E(mass, q_in, c * (r + wall))
    system.E(mass, q_out, -c * wall)
    system.quadratic(momentum, q_in, -s)
    system.quadratic_rate(mass, q_in, 2.0 * c * s)


def blood_vessel_crl(block: Block, at: Context, system: Assembly) -> None:
    """Write a vessel with compliance at the inlet, then resistance, stenosis and inertance carrying Q_out.

    P_in − P_out − (R + S|Q_out|) Q_out − L dQ_out/dt = 0,  Q_in − Q_out − C dP_in/dt = 0.
    """
    (momentum, mass), (p_in, q_in, p_out, q_out) = block.equations, block.variables
    r, c, l, s = at.values(block, "R_poiseuille", "C", "L", "stenosis_coefficient")
    system.F(momentum, p_in, 1.0)
    system.F(momentum, q_out, -r)
    system.F(momentum, p_out, -1.0)
    system.E(momentum, q_out, -l)
    system.F(mass, q_in, 1.0)
    system.F(mass, q_out, -1.0)
    system.E(mass, p_in, -c)
    system.quadratic(momentum, q_out, -s)


def blood_vessel_rc(block: Block, at: Context, system: Assembly) -> None:
    """Write Cp dP_in/dt + (P_in − P_out)/Rpd − Q_in = 0,  Q_in − Q_out = 0."""
    (storage, mass), (p_in, q_in, p_out, q_out) = block.equations, block.variables
    rpd, cp = at.values(block, "Rpd", "Cp")
    system.E(storage, p_in, cp)
    system.F(storage, p_in, 1.0 / rpd)
    system.F(storage, q_in, -1.0)
    system.F(storage, p_out, -1.0 / rpd)
    system.F(mass, q_in, 1.0)
    system.F(mass, q_out, -1.0)


def junction(block: Block, at: Context, system: Assembly) -> None:
    """Write one pressure at all ends, and flows in equal to flows out."""
    ends = len(block.inlets) + len(block.outlets)
    for end in range(1, ends):
        system.F(block.equations[end - 1], block.variables[0], 1.0)
        system.F(block.equations[end - 1], block.variables[2 * end], -1.0)
    for end in range(ends):
        system.F(block.equations[-1], block.variables[2 * end + 1], 1.0 if end < len(block.inlets) else -1.0)


def blood_vessel_junction(block: Block, at: Context, system: Assembly) -> None:
    """Write one inlet with a branch to each outlet: P_in − P_i − (R_i + S_i|Q_i|) Q_i − L_i dQ_i/dt = 0."""
    mass, *branches = block.equations
    p_in, q_in = block.variables[:2]
    system.F(mass, q_in, 1.0)
    for i, momentum in enumerate(branches):
        p_out, q_out = block.variables[2 + 2 * i : 4 + 2 * i]
        r, l, s = at.values(block, f"R_poiseuille[{i}]", f"L[{i}]", f"stenosis_coefficient[{i}]")
        system.F(mass, q_out, -1.0)
        system.F(momentum, p_in, 1.0)
        system.F(momentum, q_out, -r)
        system.F(momentum, p_out, -1.0)
        system.E(momentum, q_out, -l)
        system.quadratic(momentum, q_out, -s)


def flow(block: Block, at: Context, system: Assembly) -> None:
    """Write Q = Q(t)."""
    system.F(block.equations[0], block.variables[1], 1.0)
    system.c_time(block.equations[0], -1.0, at.series(block, "Q"))


def pressure(block: Block, at: Context, system: Assembly) -> None:
    """Write P = P(t)."""
    system.F(block.equations[0], block.variables[0], 1.0)
    system.c_time(block.equations[0], -1.0, at.series(block, "P"))


def resistance(block: Block, at: Context, system: Assembly) -> None:
    """Write P − R Q − Pd = 0."""
    r, pd = at.values(block, "R", "Pd")
    system.F(block.equations[0], block.variables[0], 1.0)
    system.F(block.equations[0], block.variables[1], -r)
    system.c(block.equations[0], -pd)


def rcr(block: Block, at: Context, system: Assembly) -> None:
    """Write a Windkessel: P − Rp Q − P_c = 0,  Rd Q − P_c + Pd − Rd C dP_c/dt = 0.

    The steady initial state has C = 0.
    """
    (proximal, distal), (p, q, p_c) = block.equations, block.variables
    rp, c, rd, pd = at.values(block, "Rp", "C", "Rd", "Pd")
    system.F(proximal, p, 1.0)
    system.F(proximal, q, -rp)
    system.F(proximal, p_c, -1.0)
    system.F(distal, p_c, -1.0)
    system.F(distal, q, rd)
    system.c(distal, pd)
    if not at.steady:
        system.E(distal, p_c, -rd * c)


def open_loop_coronary(block: Block, at: Context, system: Assembly) -> None:
    """Write a coronary bed Ra, Ca, Ram, Cim, Rv with myocardial pressure Pim(t) and venous pressure Pv (Kim 2010).

    Cim Rv Q − V − Ca Cim Rv dP/dt + Ra Ca Cim Rv dQ/dt − Cim Rv dV/dt + Cim (Pv − Pim + o) = 0
    Cim Rv P − Cim Rv Ra Q − (Rv + Ram) V − Cim Rv Ram dV/dt + Ram Cim Pv − Cim (Rv + Ram) (Pim − o) = 0
    with o = Pim − P_Cim at the initial state, so that V counts from there. In CORONARY_VAR_RES Ram follows the cardiac
    cycle. The steady initial state is P − (Ra + Ram + Rv) Q − Pv = 0, V = 0.
    """
    (first, second), (p, q, v) = block.equations, block.variables
    ra, rv, ca, cim, pv = at.values(block, "Ra1", "Rv1", "Ca", "Cc", "P_v")
    if at.steady:
        ram = initial_ram(block, at)
        system.F(first, v, 1.0)
        system.F(second, p, -1.0)
        system.F(second, q, ra + ram + rv)
        system.c(second, pv)
        return
    pim, offset = at.series(block, "Pim"), at.offset(block)
    system.F(first, q, cim * rv)
    system.F(first, v, -1.0)
    system.E(first, p, -ca * cim * rv)
    system.E(first, q, ra * ca * cim * rv)
    system.E(first, v, -cim * rv)
    system.c(first, cim * (pv + offset))
    system.c_time(first, -cim, pim)
    system.F(second, p, cim * rv)
    system.F(second, q, -cim * rv * ra)
    if block.kind == "CORONARY":
        (ram,) = at.values(block, "Ra2")
        system.F(second, v, -(rv + ram))
        system.E(second, v, -cim * rv * ram)
        system.c(second, cim * (ram * pv + (rv + ram) * offset))
        system.c_time(second, -cim * (rv + ram), pim)
    else:
        ram = varying_ram(block, at)
        system.F(second, v, -rv)
        system.F_time(second, v, -1.0, ram)
        system.E_time(second, v, -cim * rv, ram)
        system.c(second, cim * rv * offset)
        system.c_time(second, cim * (pv + offset), ram)
        system.c_time(second, -cim * rv, pim)
        system.c_time(second, -cim, pim * ram)


def varying_ram(block: Block, at: Context) -> np.ndarray:
    """Return Ram over the cycle, (samples, times): √Ram goes from √min to √max and back, as half cosines."""
    low, high, contraction, relaxation = (
        value[:, None] for value in at.values(block, "Ra2_min", "Ra2_max", "T_vc", "T_vr")
    )
    time = at.time_in_cycle
    rising = 0.5 * (1.0 - np.cos(np.pi * time / contraction))
    falling = 0.5 * (1.0 + np.cos(np.pi * (time - contraction) / relaxation))
    share = np.where(time <= contraction, rising, np.where(time <= contraction + relaxation, falling, 0.0))
    return (np.sqrt(low) + (np.sqrt(high) - np.sqrt(low)) * share) ** 2


def initial_ram(block: Block, at: Context) -> np.ndarray:
    """Return Ram at time 0, (samples,)."""
    (ram,) = at.values(block, "Ra2" if block.kind == "CORONARY" else "Ra2_min")
    return ram


def coronary_offset(block: Block, at: Context, y: np.ndarray, ydot: np.ndarray, steady_initial: bool) -> np.ndarray:
    """Return Pim − P_Cim at the initial state (samples,); y, ydot: (samples, unknowns)."""
    p, q, _ = block.variables
    ra, ca = at.values(block, "Ra1", "Ca")
    p_ca = y[:, p] - ra * y[:, q]
    q_am = y[:, q] - ca * (ydot[:, p] - ra * ydot[:, q])
    # After a steady initial state svZeroDSolver still has the mean of Pim at this point.
    pim_0 = at.series_start(block, "Pim", steady_initial)
    return pim_0 - (p_ca - initial_ram(block, at) * q_am)


def closed_loop_rcr(block: Block, at: Context, system: Assembly) -> None:
    """Write C dP_c/dt + Q_out − Q_in = 0,  P_in − P_c − Rp Q_in = 0,  P_c − P_out − Rd Q_out = 0."""
    (storage, proximal, distal), (p_in, q_in, p_out, q_out, p_c) = block.equations, block.variables
    rp, c, rd = at.values(block, "Rp", "C", "Rd")
    system.F(storage, q_in, -1.0)
    system.F(storage, q_out, 1.0)
    if not at.steady:
        system.E(storage, p_c, c)
    system.F(proximal, p_in, 1.0)
    system.F(proximal, p_c, -1.0)
    system.F(proximal, q_in, -rp)
    system.F(distal, p_out, -1.0)
    system.F(distal, p_c, 1.0)
    system.F(distal, q_out, -rd)


def closed_loop_coronary(block: Block, at: Context, system: Assembly) -> None:
    """Write a coronary bed between vessel and heart, with P_im = im · P_ventricle (Sankaran et al. 2012).

    −P_in + (Ra + Ram) Q_in + P_out + Rv Q_out − Ram Ca dP_in/dt + Ram Ra Ca dQ_in/dt = 0
    Q_in − Q_out − Ca dP_in/dt + Ca Ra dQ_in/dt − dV/dt = 0
    Cim (P_out + Rv Q_out − im P_ventricle) − V = 0
    """
    (path, mass, volume), (p_in, q_in, p_out, q_out, v) = block.equations, block.variables
    ra, ram, rv, ca, cim = at.values(block, "Ra", "Ram", "Rv", "Ca", "Cim")
    heart = at.heart
    left = block.kind == "ClosedLoopCoronaryLeft"
    (im,) = at.values(heart, "iml" if left else "imr")
    ventricle = heart.variables[13 if left else 6]
    system.E(path, p_in, -ram * ca)
    system.E(path, q_in, ram * ra * ca)
    system.F(path, p_in, -1.0)
    system.F(path, q_in, ra + ram)
    system.F(path, p_out, 1.0)
    system.F(path, q_out, rv)
    system.E(mass, p_in, -ca)
    system.E(mass, q_in, ca * ra)
    system.E(mass, v, -1.0)
    system.F(mass, q_in, 1.0)
    system.F(mass, q_out, -1.0)
    system.F(volume, p_out, cim)
    system.F(volume, q_out, cim * rv)
    system.F(volume, v, -1.0)
    # svZeroDSolver's Jacobian leaves this term out. How many iterations follow the closing of a valve decides what flow
    # is left in it, so the same numbers need the same iterations.
    system.F_lagged(volume, ventricle, -cim * im)


def heart_and_pulmonary(block: Block, at: Context, system: Assembly) -> None:
    """Write four chambers, four diode valves with inertance and resistance, a pulmonary RC (Sankaran et al. 2012).

    Ventricles: P = E(t) (V − V_u). Atria: P = A(t) Emax (V − V_aso) + (1 − A(t)) Kxp (exp(Kxv (V − V_aso)) − 1).
    A valve is closed when the pressure across it is adverse and no flow passes; then its flow is zero. Our extension:
    the aortic valve leaks Gao_leak (P_ao − P_lv), closed or open; Gao_leak is zero unless given in the network.
    """
    e = block.equations
    (p_ra, q_return, p_ao, q_ao, v_ra, q_ra, p_rv, v_rv, q_rv, p_pul, p_la, v_la, q_la, p_lv, v_lv, q_lv) = (
        block.variables
    )

    def of(name: str) -> np.ndarray:
        return at.values(block, name)[0]

    tricuspid = system.valve(p_ra, p_rv, q_ra)
    pulmonary = system.valve(p_rv, p_pul, q_rv)
    mitral = system.valve(p_la, p_lv, q_la)
    aortic = system.valve(p_lv, p_ao, q_lv)
    atrial, elastance = at.atrial_activation(block), at.ventricular_elastance

    for chamber, equation, p, v in (("ra", e[0], p_ra, v_ra), ("la", e[8], p_la, v_la)):
        emax, rest = of(f"Emax_{chamber}"), of(f"Vaso_{chamber}")
        system.F(equation, p, 1.0)
        system.F_time(equation, v, -emax, atrial)
        system.c_time(equation, emax * rest, atrial)
        system.exponential(equation, v, of(f"Kxp_{chamber}"), of(f"Kxv_{chamber}"), rest, atrial - 1.0)
    for chamber, equation, p, v in (("rv", e[4], p_rv, v_rv), ("lv", e[11], p_lv, v_lv)):
        scale, unstressed = of(f"E{chamber}_s"), of(f"V{chamber}_u")
        system.F(equation, p, 1.0)
        system.F_time(equation, v, -scale, elastance)
        system.c_time(equation, scale * unstressed, elastance)

    leak = of("Gao_leak")
    for equation, sign in ((e[1], 1.0), (e[12], -1.0)):
        system.F(equation, p_ao, sign * leak)
        system.F(equation, p_lv, -sign * leak)
    system.E(e[1], p_ao, of("Cpa"))
    system.F(e[1], q_ao, 1.0)
    system.F_valve(e[1], q_lv, -1.0, aortic)
    system.E(e[7], p_pul, of("Cp"))
    system.F(e[7], p_pul, 1.0 / of("Rpd"))
    system.F(e[7], p_la, -1.0 / of("Rpd"))
    system.F_valve(e[7], q_rv, -1.0, pulmonary)

    system.E(e[2], v_ra, 1.0)
    system.F(e[2], q_return, -1.0)
    system.F_valve(e[2], q_ra, 1.0, tricuspid)
    system.E(e[5], v_rv, 1.0)
    system.F_valve(e[5], q_ra, -1.0, tricuspid)
    system.F_valve(e[5], q_rv, 1.0, pulmonary)
    system.E(e[9], v_la, 1.0)
    # As in svZeroDSolver: the left atrium fills with the flow out of the right ventricle, not with that through Rpd, so
    # the pulmonary capacitor's volume is not part of the loop's conserved volume.
    system.F_valve(e[9], q_rv, -1.0, pulmonary)
    system.F_valve(e[9], q_la, 1.0, mitral)
    system.E(e[12], v_lv, 1.0)
    system.F_valve(e[12], q_la, -1.0, mitral)
    system.F_valve(e[12], q_lv, 1.0, aortic)

    for equation, upstream, downstream, q, l, r, valve in (
        (e[3], p_ra, p_rv, q_ra, "Lra_v", "Rra_v", tricuspid),
        (e[6], p_rv, p_pul, q_rv, "Lrv_a", "Rrv_a", pulmonary),
        (e[10], p_la, p_lv, q_la, "Lla_v", "Rla_v", mitral),
        (e[13], p_lv, p_ao, q_lv, "Llv_a", "Rlv_ao", aortic),
    ):
        system.E(equation, q, of(l))
        system.F(equation, upstream, -1.0)
        system.F(equation, downstream, 1.0)
        system.F_valve(equation, q, of(r), valve)


ELEMENTS: dict[str, Write] = {
    "BloodVessel": blood_vessel,
    "BloodVesselCRL": blood_vessel_crl,
    "BloodVesselRC": blood_vessel_rc,
    "NORMAL_JUNCTION": junction,
    "internal_junction": junction,
    "BloodVesselJunction": blood_vessel_junction,
    "FLOW": flow,
    "PRESSURE": pressure,
    "RESISTANCE": resistance,
    "RCR": rcr,
    "CORONARY": open_loop_coronary,
    "CORONARY_VAR_RES": open_loop_coronary,
    "ClosedLoopRCR": closed_loop_rcr,
    "ClosedLoopCoronaryLeft": closed_loop_coronary,
    "ClosedLoopCoronaryRight": closed_loop_coronary,
    "ClosedLoopHeartAndPulmonary": heart_and_pulmonary,
    "ValveTanh": chambers.valve_tanh,
    "PiecewiseValve": chambers.piecewise_valve,
    "LinearElastanceChamber": chambers.linear_elastance_chamber,
    "ChamberElastanceInductor": chambers.chamber_elastance_inductor,
    "ChamberElastanceInductorExponential": chambers.chamber_elastance_inductor_exponential,
}
