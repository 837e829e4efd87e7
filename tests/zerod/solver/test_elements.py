"""Networks agree with the same equations written by hand as ODEs and integrated by scipy at tight tolerance.

Neither the assembly nor the elimination nor the time scheme of the engine takes part in the ODEs.
"""

import copy

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from coronaryuq.zerod.solver.assembly import ELASTANCE_MODES
from coronaryuq.zerod.solver.engine import Engine
from support.zerod_networks import HEART, MMHG, boundary, network, vessel

_STEPS = 2000


def _smooth(time):
    """Return a pulse that begins at rest, as the network does."""
    return 40.0 * (1.0 - np.cos(2 * np.pi * time)) + 10.0 * (1.0 - np.cos(6 * np.pi * time))


@settings(max_examples=4, deadline=None, derandomize=True)
@given(
    r=st.floats(5.0, 200.0),
    l=st.floats(0.5, 20.0),
    s=st.floats(0.0, 3.0),
    rp=st.floats(50.0, 500.0),
    rd=st.floats(500.0, 3000.0),
    c=st.floats(1e-4, 1e-3),
)
def test_a_stenosed_vessel_with_a_windkessel_agrees_with_an_ode_solver(r, l, s, rp, rd, c):
    """States: flow q through R, S, L and pressure p at the capacitor; driven by a pressure."""
    times = np.linspace(0.0, 1.0, _STEPS + 1)
    drive = MMHG * _smooth(times)
    tube = network(
        [vessel(0, "tube", inlet="IN", outlet="OUT", R_poiseuille=r, L=l, stenosis_coefficient=s)],
        [
            boundary("IN", "PRESSURE", t=times.tolist(), P=drive.tolist()),
            boundary("OUT", "RCR", Rp=rp, C=c, Rd=rd, Pd=0.0),
        ],
        steps=_STEPS,
        steady_initial=False,
        absolute_tolerance=1e-6,
    )
    tube["initial_condition"] = {"flow_all": 0.0, "pressure_c:OUT": 0.0}
    result = Engine(tube).run_cycles(waveforms=["flow:IN:tube", "pressure_c:OUT"], cycles=1)

    def rates(time, state):
        q, p = state
        return [(MMHG * _smooth(time) - (r + s * abs(q)) * q - rp * q - p) / l, (q - p / rd) / c]

    exact = solve_ivp(rates, (0.0, 1.0), [0.0, 0.0], "LSODA", rtol=1e-8, atol=1e-6, t_eval=times)
    for name, expected in zip(("flow:IN:tube", "pressure_c:OUT"), exact.y, strict=True):
        actual = result.waveforms[name][0]
        assert np.abs(actual - expected).max() < 2e-4 * np.abs(expected).max(), name


def test_a_viscous_wall_has_the_impedance_of_kelvin_and_voigt():
    """A sinusoidal inflow meets R_wall + 1 / (i w C) beside the resistance behind the vessel; 0 is an elastic wall."""
    c, wall, distal, omega = 2e-4, 400.0, 2000.0, 2.0 * np.pi
    times = np.linspace(0.0, 1.0, 401)
    tube = network(
        [vessel(0, "tube", inlet="IN", outlet="OUT", R_poiseuille=0.0, C=c)],
        [
            boundary("IN", "FLOW", t=times.tolist(), Q=(5.0 + 2.0 * np.cos(omega * times)).tolist()),
            boundary("OUT", "RESISTANCE", R=distal, Pd=0.0),
        ],
        steps=400,
    )
    resistances = np.array([0.0, wall])
    found = Engine(tube).run_to_periodic({"tube.R_wall": resistances}, waveforms=["pressure:IN:tube"])
    for resistance, pressure in zip(resistances, found.waveforms["pressure:IN:tube"], strict=True):
        impedance = 1.0 / (1.0 / distal + 1.0 / (resistance + 1.0 / (1j * omega * c)))
        expected = 5.0 * distal + np.real(2.0 * impedance * np.exp(1j * omega * times))
        assert np.abs(pressure - expected).max() < 1e-3 * np.ptp(expected)
    written = copy.deepcopy(tube)
    written["vessels"][0]["zero_d_element_values"]["R_wall"] = wall
    alone = Engine(written).run_to_periodic(waveforms=["pressure:IN:tube"]).waveforms["pressure:IN:tube"][0]
    assert alone == pytest.approx(found.waveforms["pressure:IN:tube"][1], rel=1e-6)


def _elastance(phase):
    angle = 2.0 * np.pi * np.arange(len(ELASTANCE_MODES)) * phase
    return float(ELASTANCE_MODES[:, 0] @ np.cos(angle) - ELASTANCE_MODES[:, 1] @ np.sin(angle))


def _atrial(time, period, tsa, tpwave):
    tsa, tpwave = period * tsa, period / tpwave
    if time <= tpwave:
        return 0.5 * (1.0 - np.cos(2.0 * np.pi * (time - tpwave + tsa) / tsa))
    if time >= period - tsa + tpwave:
        return 0.5 * (1.0 - np.cos(2.0 * np.pi * (time - tpwave - (period - tsa)) / tsa))
    return 0.0


_BED = st.fixed_dictionaries(
    {
        "side": st.sampled_from(["Left", "Right"]),
        "Ra": st.floats(5.0, 40.0),
        "Ram": st.floats(10.0, 60.0),
        "Rv": st.floats(5.0, 40.0),
        "Ca": st.floats(2e-4, 2e-3),
        "Cim": st.floats(2e-3, 1e-2),
    }
)
"""A coronary bed, in mmHg and mL."""


_TYPICAL = {"Ra": 9.3, "Ram": 15.1, "Rv": 33.3, "Ca": 5.5e-4, "Cim": 3.7e-3}


@pytest.mark.slow
@settings(max_examples=5, deadline=None, derandomize=True)
@example(1.0, 1.0, 1.0, [{"side": side, **_TYPICAL} for side in ("Left", "Right")])
@given(
    elastance=st.floats(0.7, 1.4),
    systemic=st.floats(0.7, 1.4),
    compliance=st.floats(0.7, 1.5),
    beds=st.lists(_BED, max_size=3),
)
def test_a_closed_loop_with_valves_agrees_with_an_ode_solver(elastance, systemic, compliance, beds):
    """Heart, pulmonary RC, systemic windkessel and any number of coronary beds; each valve a diode with inertance."""
    h = HEART | {"Elv_s": HEART["Elv_s"] * elastance}
    rp, rd, c = 0.13 * MMHG, 1.36 * MMHG * systemic, 0.24 / MMHG * compliance
    beds = [
        {k: v if k == "side" else v / MMHG if k.startswith("C") else v * MMHG for k, v in bed.items()} for bed in beds
    ]
    period, steps, count = 1.0, 4000, len(beds)
    loop = network(
        [
            vessel(0, "aorta", outlet="SYSTEMIC", R_poiseuille=4.0),
            *(vessel(k + 1, f"artery{k}", outlet=f"BED{k}", R_poiseuille=50.0) for k in range(count)),
        ],
        [
            boundary("SYSTEMIC", "ClosedLoopRCR", Rp=rp, Rd=rd, C=c, closed_loop_outlet=True),
            *(
                boundary(f"BED{k}", f"ClosedLoopCoronary{bed['side']}", **{n: v for n, v in bed.items() if n != "side"})
                for k, bed in enumerate(beds)
            ),
        ],
        steps=steps,
        steady_initial=False,
    )
    outlets = ["aorta", *(f"artery{k}" for k in range(count))]
    heart = {"outlet_blocks": outlets, "closed_loop_type": "ClosedLoopHeartAndPulmonary"}
    loop["closed_loop_blocks"] = [{**heart, "cardiac_cycle_period": period, "parameters": h}]
    volumes = {"V_RA:CLH": 38.43, "V_RV:CLH": 96.07, "V_LA:CLH": 38.43, "V_LV:CLH": 96.07}
    stored = {f"volume_im:BED{k}": bed["Cim"] * 70.0 * MMHG for k, bed in enumerate(beds)}
    loop["initial_condition"] = {**volumes, **stored, "P_pul:CLH": 8.0 * MMHG, "pressure_all": 70.0 * MMHG}
    names = ["pressure:CLH:J_heart_outlet", "V_LV:CLH", "V_LA:CLH", "V_RV:CLH", "P_pul:CLH", "P_c:SYSTEMIC"]
    places = [9, 3, 2, 1, 8, 10]
    names += [f"volume_im:BED{k}" for k in range(count)]
    places += [11 + count + k for k in range(count)]
    result = Engine(loop).run_cycles(waveforms=names, cycles=1)

    def pressures(time, v_ra, v_rv, v_la, v_lv):
        a, e = _atrial(time, period, h["Tsa"], h["tpwave"]), _elastance(time / period)
        atria = [
            a * h[f"Emax_{x}"] * (v - h[f"Vaso_{x}"])
            + (1.0 - a) * h[f"Kxp_{x}"] * (np.exp(h[f"Kxv_{x}"] * (v - h[f"Vaso_{x}"])) - 1.0)
            for x, v in (("ra", v_ra), ("la", v_la))
        ]
        return atria[0], e * h["Erv_s"] * (v_rv - h["Vrv_u"]), atria[1], e * h["Elv_s"] * (v_lv - h["Vlv_u"])

    def flow_rate(q, up, down, l, r):
        """A diode: shut while no flow passes and the pressure is adverse."""
        rate = (up - down - r * q) / l
        return rate if q > 0.0 or rate > 0.0 else 0.0

    def rates(time, state):
        v_ra, v_rv, v_la, v_lv, q_ra, q_rv, q_la, q_lv, p_pul, p_ao, p_c = state[:11]
        p_ra, p_rv, p_la, p_lv = pressures(time, v_ra, v_rv, v_la, v_lv)
        q_ra, q_rv, q_la, q_lv = (max(q, 0.0) for q in (q_ra, q_rv, q_la, q_lv))
        into = (p_ao - p_c) / (4.0 + rp)
        back = (p_c - p_ra) / rd
        taken, returned, filled, squeezed = 0.0, back, [], []
        for bed, p_a, v_im in zip(beds, state[11 : 11 + count], state[11 + count :], strict=True):
            share, ventricle = (h["iml"], p_lv) if bed["side"] == "Left" else (h["imr"], p_rv)
            p_im = v_im / bed["Cim"] + share * ventricle
            artery, middle = (p_ao - p_a) / (50.0 + bed["Ra"]), (p_a - p_im) / bed["Ram"]
            vein = (p_im - p_ra) / bed["Rv"]
            filled.append((artery - middle) / bed["Ca"])
            squeezed.append(middle - vein)
            taken, returned = taken + artery, returned + vein
        return [
            *(returned - q_ra, q_ra - q_rv, q_rv - q_la, q_la - q_lv),
            flow_rate(q_ra, p_ra, p_rv, h["Lra_v"], h["Rra_v"]),
            flow_rate(q_rv, p_rv, p_pul, h["Lrv_a"], h["Rrv_a"]),
            flow_rate(q_la, p_la, p_lv, h["Lla_v"], h["Rla_v"]),
            flow_rate(q_lv, p_lv, p_ao, h["Llv_a"], h["Rlv_ao"]),
            (q_rv - (p_pul - p_la) / h["Rpd"]) / h["Cp"],
            (q_lv - into - taken) / h["Cpa"],
            (into - back) / c,
            *filled,
            *squeezed,
        ]

    start = [38.43, 96.07, 38.43, 96.07, 0.0, 0.0, 0.0, 0.0, 8.0 * MMHG, 70.0 * MMHG, 70.0 * MMHG]
    start += [70.0 * MMHG] * count + list(stored.values())
    times = np.linspace(0.0, period, steps + 1)
    exact = solve_ivp(rates, (0.0, period), start, "RK45", rtol=1e-6, atol=1e-6, max_step=1e-3, t_eval=times)
    for name, place in zip(names, places, strict=True):
        expected, found = exact.y[place], result.waveforms[name][0]
        assert np.abs(found - expected).max() < 5e-3 * np.abs(expected).max(), name
