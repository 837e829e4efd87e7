"""Benchmark `perfusion`: noisy perfusion realisations on a large left ventricle, all default noise models."""

import resource
import sys
import time

import numpy as np

from coronaryuq.perfusion.realisations import NoiseStudy
from coronaryuq.perfusion.settings import Settings
from coronaryuq.perfusion.territories import Ventricle, distances_to_points

POINTS, OUTLETS, REALISATIONS, QUICK_REALISATIONS = 100_000, 14, 2500, 250


def run(quick: bool) -> dict:
    """Time 2500 realisations (quick: 250) on 100,000 points and 14 outlets, without compilation."""
    realisations = QUICK_REALISATIONS if quick else REALISATIONS
    ventricle, centres = _shell(POINTS), _spread(OUTLETS)
    settings = Settings()
    distances = distances_to_points(ventricle.points, centres)
    warm = NoiseStudy(_part(ventricle, 50), distances[:50], settings.models, settings.correlation_length, 1)
    started = time.process_time()
    warm.flows(0)
    compiled = time.process_time()
    study = NoiseStudy(ventricle, distances, settings.models, settings.correlation_length, 1)
    for index in range(realisations):
        study.flows(index)
        if (index + 1) % 250 == 0:
            print(f"realisation {index + 1}/{realisations}", file=sys.stderr, flush=True)
    cpu = time.process_time() - compiled
    return {
        "realisations": realisations,
        "points": POINTS,
        "outlets": OUTLETS,
        "cpu_s": round(cpu, 2),
        "peak_rss_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
        "noise_models": list(settings.models),
        "cpu_ns_per_point_and_realisation": round(cpu / realisations / POINTS * 1e9, 1),
        "compile_s": round(compiled - started, 2),
        "candidates_per_point": round(max(len(c.outlet) for c in study.candidates.values()) / POINTS, 2),
    }


def _shell(points: int) -> Ventricle:
    """Return points spread evenly through the wall of a half ellipsoid of 130 cm3, perfused at 2.5 mL/min/g."""
    random = np.random.default_rng(0)
    direction = random.normal(size=(3 * points, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    direction = direction[direction[:, 2] < 0.35][:points]
    depth = random.uniform(0.8, 1.15, size=(points, 1))
    volumes = np.full(points, 130.0 / points)
    return Ventricle(direction * depth * [3.0, 3.0, 5.0], volumes, volumes * 1.05 * 2.5 / 60.0)


def _spread(count: int) -> np.ndarray:
    """Return points (count, 3) on the epicardium, on a spiral from apex to base."""
    height = np.linspace(-0.95, 0.3, count)
    angle = np.arange(count) * 2.399963
    ring = np.sqrt(1.0 - height**2)
    return 1.15 * np.stack([3.0 * ring * np.cos(angle), 3.0 * ring * np.sin(angle), 5.0 * height], axis=1)


def _part(ventricle: Ventricle, points: int) -> Ventricle:
    return Ventricle(ventricle.points[:points], ventricle.volumes[:points], ventricle.flows[:points])
