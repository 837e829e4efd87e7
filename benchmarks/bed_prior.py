"""Which prior of the beds' resistances lets a measured flow tell a stenosis from its bed?

Three arteries, each with one bed and perhaps a stenosis whose loss is Poiseuille's and Young and Tsai's; random
patients as in the end-to-end benchmark; posteriors by importance sampling from the prior, so that no sampler and no 3D
run is in between. `flow`: shares of conductance follow the measured flow, the total is that of the segmented lumen, the
prior is uniform from half to twice that, and s is uniform (paper). `gram`: conductance per gram is lognormal with the
spread that is tried, and the total follows from the measured one.

    python benchmarks/bed_prior.py [PATIENTS]
"""

import json
import sys
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

MMHG, DENSITY, VISCOSITY = 1333.22, 1.06, 0.04
MASS = np.array([54.0, 36.0, 30.0])
"""g, of the territories of LAD, LCx and RCA."""
RADIUS, LENGTH = np.array([0.17, 0.15, 0.16]), 0.9
"""cm, of a healthy lumen, and of a stenosis."""
BED_NOISE, CALIBRATION = 0.2 / np.sqrt(5.0), 0.1
"""Relative errors of an artery's flow, from five outlets with 20 % each, and of the whole map."""
COMMON, LOCAL = 0.035 * 0.15, 0.035 * 0.30
"""Errors of the segmented radius, cm; the local one grows with the fraction of the radius that is lost."""
DRAWS = 200_000
SPREADS = (0.12, 0.2, 0.3, 0.5)


def flow(pressure: float, conductance: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return the flows, mL/s, of beds behind stenoses of these radii."""
    viscous = 1.0 / conductance + 8.0 * VISCOSITY * LENGTH / (np.pi * radius**4) / MMHG
    healthy = np.pi * RADIUS**2
    turbulent = 0.76 * DENSITY * (healthy / (np.pi * radius**2) - 1.0) ** 2 / healthy**2 / MMHG
    return 2.0 * pressure / (viscous + np.sqrt(viscous**2 + 4.0 * turbulent * pressure))


def total(flows: float, pressure: float, shares: np.ndarray, radius: np.ndarray) -> float:
    """Return the total conductance at which beds of these shares have the total flow."""
    return brentq(lambda g: flow(pressure, shares * g, radius).sum() - flows, 1e-6, 1e4)


@dataclass(frozen=True)
class Patient:
    """Which arteries have a stenosis, segmented radii, the spread of their logarithm, pressure, flows, true FFR."""

    stenosed: np.ndarray
    radius: np.ndarray
    spread: np.ndarray
    pressure: float
    measured: np.ndarray
    ffr: np.ndarray


def patient(random: np.random.Generator) -> Patient:
    stenosed = np.zeros(3, dtype=bool)
    stenosed[random.permutation(3)[: random.choice(4, p=(0.1, 0.35, 0.35, 0.2))]] = True
    lost = np.where(stenosed, random.uniform(0.3, 0.75, 3), 0.0)
    radius = RADIUS * (1.0 - lost)
    spread = np.sqrt(np.log1p((np.hypot(COMMON, LOCAL * (1.0 + lost)) / radius) ** 2))
    true = lumen(stenosed, radius, spread, random.standard_normal(3))
    conductance = MASS * random.uniform(0.75, 1.10, 3) * np.exp(0.12 / np.sqrt(5.0) * random.standard_normal(3))
    pressure = random.uniform(82.0, 106.0)
    conductance *= total(random.uniform(1.2, 2.6) * MASS.sum() / 60.0, pressure, conductance, true)
    flows = flow(pressure, conductance, true)
    seen = flows * (1.0 + BED_NOISE * random.standard_normal(3)) * (1.0 + CALIBRATION * random.standard_normal())
    return Patient(stenosed, radius, spread, pressure, seen, flows / conductance / pressure)


def lumen(stenosed: np.ndarray, radius: np.ndarray, spread: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return radii whose mean is the segmented one, no wider than healthy."""
    return np.where(stenosed, np.minimum(radius * np.exp(spread * z - 0.5 * spread**2), RADIUS), radius)


def by_flow(seen: Patient, radius: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return conductances (n, 3) of the paper's prior, and the logarithm of their weights (n,)."""
    shares = seen.measured / seen.measured.sum()
    conductance = total(seen.measured.sum(), seen.pressure, shares, seen.radius)
    m = random.uniform(0.5, 2.0, (len(radius), 3))
    last = int(np.argmax(shares))
    left = 1.0 - np.sum(np.delete(shares / m, last, axis=1), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        m[:, last] = shares[last] / left
        inside = (m[:, last] > 0.5) & (m[:, last] < 2.0)
        beds = np.where(inside[:, None], shares * conductance / m, 1.0)
        error = flow(seen.pressure, beds, radius) / seen.measured - 1.0
        weight = 2.0 * np.log(m[:, last]) - 0.5 * np.sum((error / BED_NOISE) ** 2, axis=1)
    return beds / random.uniform(0.7, 1.25, (len(radius), 1)), np.where(inside, weight, -np.inf)


def by_gram(
    seen: Patient, radius: np.ndarray, random: np.random.Generator, spread: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return conductances (n, 3) of the prior per gram, and the logarithm of their weights (n,)."""
    level = np.log(seen.measured.sum() / seen.pressure) + random.uniform(-0.7, 2.0, (len(radius), 1))
    beds = MASS / MASS.sum() * np.exp(level + spread * random.standard_normal((len(radius), 3)))
    error = flow(seen.pressure, beds, radius) / seen.measured - 1.0
    precision = np.linalg.inv(BED_NOISE**2 * np.eye(3) + CALIBRATION**2)
    return beds, -0.5 * np.einsum("ni,ij,nj->n", error, precision, error)


def score(prior: str, patients: int, spread: float = 0.0) -> dict:
    """Return how FFR of the patients' stenoses lies in the posteriors' ranges."""
    random, found = np.random.default_rng(1), []
    for _ in range(patients):
        seen = patient(random)
        radius = lumen(seen.stenosed, seen.radius, seen.spread, random.standard_normal((DRAWS, 3)))
        beds, weight = (
            by_flow(seen, radius, random) if prior == "flow" else by_gram(seen, radius, random, spread)
        )  # fmt: skip
        ffr = flow(seen.pressure, beds, radius) / beds / seen.pressure
        weight = np.exp(weight - weight.max()) / np.exp(weight - weight.max()).sum()
        for artery in np.flatnonzero(seen.stenosed).tolist():
            order = np.argsort(ffr[:, artery])
            quantiles = np.interp((0.05, 0.5, 0.95), np.cumsum(weight[order]), ffr[order, artery])
            found.append([seen.ffr[artery], *quantiles])
    true, low, median, high = np.array(found).T
    tight = true <= 0.8
    return {
        "prior": prior, "spread": spread or None, "stenoses": len(true),
        "in_90_percent_ranges": round(float(np.mean((true >= low) & (true <= high))), 3),
        "width": round(float(np.mean(high - low)), 3),
        "bias": round(float(np.mean(median - true)), 3),
        "bias_where_at_most_0.80": round(float(np.mean((median - true)[tight])), 3),
        "rms_error": round(float(np.sqrt(np.mean((median - true) ** 2))), 3),
    }  # fmt: skip


if __name__ == "__main__":
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    rows = [score("flow", number), *(score("gram", number, spread) for spread in SPREADS)]
    print(json.dumps(rows, indent=1))
