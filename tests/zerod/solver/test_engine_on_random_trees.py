"""Runs of random trees conserve mass, are linear without stenoses, and agree with an ODE solver."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.periodic import Periodicity
from support.zerod_networks import boundary, network, vessel


@dataclass(frozen=True)
class Tree:
    """A tree of vessels with Windkessels at its ends.

    parents: vessel upstream of each, None for the first. r, l, c, s: of each vessel. windkessels: Rp, C, Rd per vessel,
    used if it ends the tree. crl: vessels with the compliance at their inlet.
    """

    parents: tuple
    r: tuple
    l: tuple
    c: tuple
    s: tuple
    windkessels: tuple
    crl: tuple

    def children(self, k: int) -> list[int]:
        return [child for child, parent in enumerate(self.parents) if parent == k]

    @property
    def ends(self) -> list[int]:
        return [k for k in range(len(self.parents)) if not self.children(k)]


@st.composite
def trees(draw, stenosed: bool, largest: int = 6, kinds: bool = True) -> Tree:
    size = draw(st.integers(2, largest))
    parents = (None, *(draw(st.integers(0, k - 1)) for k in range(1, size)))

    def each(low, high):
        return tuple(draw(st.floats(low, high)) for _ in range(size))

    return Tree(
        parents,
        each(30.0, 300.0),
        each(1.0, 10.0),
        each(3e-5, 2e-4),
        each(0.5, 5.0) if stenosed else (0.0,) * size,
        tuple(zip(each(100.0, 600.0), each(1e-4, 8e-4), each(1000.0, 6000.0), strict=True)),
        tuple(draw(st.booleans()) if kinds else False for _ in range(size)),
    )


def network_of(tree: Tree, inflow, steps: int, **simulation) -> dict:
    """inflow: values of the flow into the first vessel, evenly over a period of 1 s."""
    vessels = [
        vessel(
            k,
            f"v{k}",
            inlet="IN" if k == 0 else None,
            outlet=f"BED{k}" if k in tree.ends else None,
            kind="BloodVesselCRL" if tree.crl[k] else "BloodVessel",
            R_poiseuille=tree.r[k],
            L=tree.l[k],
            C=tree.c[k],
            stenosis_coefficient=tree.s[k],
        )
        for k in range(len(tree.parents))
    ]
    junctions = [
        {
            "junction_name": f"J{k}",
            "junction_type": "NORMAL_JUNCTION",
            "inlet_vessels": [k],
            "outlet_vessels": tree.children(k),
        }
        for k in range(len(tree.parents))
        if tree.children(k)
    ]
    beds = [
        boundary(f"BED{k}", "RCR", **dict(zip(("Rp", "C", "Rd"), tree.windkessels[k], strict=True)), Pd=0.0)
        for k in tree.ends
    ]
    times = np.linspace(0.0, 1.0, len(inflow))
    beds.append(boundary("IN", "FLOW", t=times.tolist(), Q=np.asarray(inflow, float).tolist()))
    return network(vessels, beds, junctions, steps=steps, steady_initial=False, **simulation)


def pulse(time):
    """Return an inflow that begins at rest, as the network does, and ends at zero."""
    return 4.0 * (1.0 - np.cos(2 * np.pi * time)) + (1.0 - np.cos(6 * np.pi * time))


TIMES = np.linspace(0.0, 1.0, 401)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(tree=trees(stenosed=True))
def test_flow_into_a_random_tree_equals_flow_out_of_it(tree):
    """At every junction at every step; at the ends of the tree over a periodic cycle."""
    engine = Engine(network_of(tree, pulse(TIMES), 200, absolute_tolerance=1e-7))
    flows = [name for name in engine.unknowns if name.startswith("flow")]
    result = engine.run_to_periodic(waveforms=flows, periodicity=Periodicity(tolerance=1e-6))
    assert result.ok[0], result.status[0]
    for k in range(len(tree.parents)):
        if tree.children(k):
            into = result.waveforms[f"flow:v{k}:J{k}"][0]
            out = sum(result.waveforms[f"flow:J{k}:v{child}"][0] for child in tree.children(k))
            assert np.abs(into - out).max() < 1e-8 * np.abs(into).max()
    mean = {name: np.trapezoid(result.waveforms[name][0]) / 200 for name in flows}
    assert np.isclose(mean["flow:IN:v0"], sum(mean[f"flow:v{k}:BED{k}"] for k in tree.ends), rtol=1e-4)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(tree=trees(stenosed=False), a=st.floats(-3.0, 3.0), b=st.floats(-3.0, 3.0))
def test_a_random_tree_without_stenoses_is_linear_in_its_inflow(tree, a, b):
    first, second = pulse(TIMES), 2.0 * np.sin(2 * np.pi * TIMES) + 1.0
    waves = []
    for inflow in (first, second, a * first + b * second):
        engine = Engine(network_of(tree, inflow, 100))
        names = engine.unknowns
        recorded = engine.run_cycles(waveforms=names, cycles=2).waveforms
        waves.append(np.array([recorded[name][0] for name in names]))
    size = np.abs(waves[0]).max(axis=1) + np.abs(waves[1]).max(axis=1)
    assert (np.abs(a * waves[0] + b * waves[1] - waves[2]).max(axis=1) <= 1e-8 * (1.0 + size)).all()


def _rates(tree: Tree):
    """Write the tree as an ODE in the pressure and outflow of each vessel's compliance and the pressure of each bed."""
    size, ends = len(tree.parents), tree.ends

    def flow_in(k, pressure, at_compliance):
        """Return the flow from the inlet through resistance and stenosis to the compliance."""
        drop = pressure - at_compliance
        if tree.s[k] == 0.0:
            return drop / tree.r[k]
        root = np.sqrt(tree.r[k] ** 2 + 4.0 * tree.s[k] * abs(drop))
        return np.sign(drop) * (root - tree.r[k]) / (2.0 * tree.s[k])

    def junction_pressure(children, total, at_compliance):
        """Find by bisection the pressure at which the flows into the children sum to `total`."""
        reach = 1.0 + abs(total) * max(tree.r[k] + tree.s[k] * abs(total) for k in children)
        low = min(at_compliance[k] for k in children) - reach
        high = max(at_compliance[k] for k in children) + reach
        for _ in range(80):
            middle = 0.5 * (low + high)
            if sum(flow_in(k, middle, at_compliance[k]) for k in children) < total:
                low = middle
            else:
                high = middle
        return 0.5 * (low + high)

    def rates(time, state):
        at_compliance, out, beds = state[:size], state[size : 2 * size], dict(zip(ends, state[2 * size :], strict=True))
        into, beyond = np.zeros(size), np.zeros(size)
        into[0] = pulse(time)
        for k in range(size):
            children = tree.children(k)
            if not children:
                beyond[k] = beds[k] + tree.windkessels[k][0] * out[k]
            elif len(children) == 1:
                (child,) = children
                into[child] = out[k]
                beyond[k] = at_compliance[child] + (tree.r[child] + tree.s[child] * abs(out[k])) * out[k]
            else:
                beyond[k] = junction_pressure(children, out[k], at_compliance)
                for child in children:
                    into[child] = flow_in(child, beyond[k], at_compliance[child])
        stored = [(into[k] - out[k]) / tree.c[k] for k in range(size)]
        gained = [(at_compliance[k] - beyond[k]) / tree.l[k] for k in range(size)]
        filled = [(out[k] - beds[k] / tree.windkessels[k][2]) / tree.windkessels[k][1] for k in ends]
        return [*stored, *gained, *filled]

    return rates


@pytest.mark.slow
@settings(max_examples=15, deadline=None, derandomize=True)
@given(tree=trees(stenosed=True, largest=4, kinds=False))
def test_a_random_stenosed_tree_agrees_with_an_ode_solver(tree):
    steps, size = 2000, len(tree.parents)
    times = np.linspace(0.0, 1.0, steps + 1)
    engine = Engine(network_of(tree, pulse(times), steps, absolute_tolerance=1e-6))
    names = [f"flow:v{k}:BED{k}" for k in tree.ends] + [f"pressure_c:BED{k}" for k in tree.ends]
    recorded = engine.run_cycles(waveforms=names, cycles=1).waveforms
    exact = solve_ivp(
        _rates(tree), (0.0, 1.0), np.zeros(2 * size + len(tree.ends)), "LSODA", rtol=1e-7, atol=1e-7, t_eval=times[::10]
    )
    expected = [exact.y[size + k] for k in tree.ends] + [exact.y[2 * size + k] for k in range(len(tree.ends))]
    for name, wave in zip(names, expected, strict=True):
        assert np.abs(recorded[name][0, ::10] - wave).max() < 1e-3 * np.abs(wave).max(), name
