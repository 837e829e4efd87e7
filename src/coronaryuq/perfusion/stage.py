"""The perfusion stage: chunks of noisy realisations, gathered into target flows and their covariance."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from coronaryuq.case.case_json import CaseOutlet, CaseSummary, read_case
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import replacing, write_json
from coronaryuq.core.io.tables import read_npz
from coronaryuq.core.provenance import stamp
from coronaryuq.perfusion.covariance import noise_statistics, rescaled
from coronaryuq.perfusion.further_errors import Distances, FurtherErrors, further_errors
from coronaryuq.perfusion.realisations import NoiseStudy
from coronaryuq.perfusion.settings import Settings
from coronaryuq.perfusion.targets import PerfusionTargets, VentricleTotals
from coronaryuq.perfusion.territories import (
    Ventricle,
    distances_to_centrelines,
    distances_to_points,
    nearest_outlets,
    perfusing_outlets,
    weighted_distances,
)


def run_chunk(
    case_json: str | Path, lv_vtu: str | Path, settings: Settings, seed: int, first: int, number: int,
    out_npz: str | Path,
) -> None:  # fmt: skip
    """Simulate realisations `first` to `first + number - 1` of every noise model and write them.

    The file holds `first`, `seed`, and for each model NAME `flow_NAME` (number, outlets) in mL/s and `volume_NAME` in
    cm3. A realisation depends on the seed and its index, not on the chunk.

    Raises
    ------
    InputError
        If an outlet's territory is empty, or a file is missing or invalid.
    """
    case, outlets, ventricle, distances = _read(case_json, lv_vtu, settings)
    nearest_outlets(distances, ventricle.volumes, outlets, case_json)
    study = NoiseStudy(ventricle, distances, settings.models, settings.correlation_length, seed)
    realisations = [study.flows(index) for index in range(first, first + number)]
    arrays: dict[str, Any] = {"first": np.int64(first), "seed": np.int64(seed)}
    for name in settings.models:
        arrays[f"flow_{name}"] = np.array([r[name][0] for r in realisations])
        arrays[f"volume_{name}"] = np.array([r[name][1] for r in realisations])
    with replacing(out_npz) as beside:
        np.savez(beside, **arrays)


def gather(
    chunks: Sequence[str | Path], case_json: str | Path, lv_vtu: str | Path, settings: Settings, out_json: str | Path
) -> None:
    """Gather chunks into `targets.json` (`PerfusionTargets`).

    Raises
    ------
    InputError
        If a chunk is missing, occurs twice, or has another seed or other noise models.
    """
    case, outlets, ventricle, distances = _read(case_json, lv_vtu, settings)
    territory = nearest_outlets(distances, ventricle.volumes, outlets, case_json)
    flows, volumes, seed = _join(chunks, settings)
    baseline = np.bincount(territory, weights=ventricle.flows, minlength=len(outlets))
    volume = np.bincount(territory, weights=ventricle.volumes, minlength=len(outlets))
    models = {
        name: noise_statistics(model, flows[name], volumes[name], baseline) for name, model in settings.models.items()
    }
    used = models[settings.use]
    mean = baseline if settings.mean == "baseline" else used.mean
    covariance = used.covariance
    if settings.branch_sd is not None:
        covariance = rescaled(covariance, settings.branch_sd * mean)
    further = FurtherErrors(mean, {}, {})
    if case.errors is not None:
        rules = _rules(case_json, outlets, settings)
        further = further_errors(ventricle, outlets, rules, mean, case.errors, seed)
        covariance = covariance + sum(further.covariances.values())
        mean = further.mean
    lv = VentricleTotals(
        volume=ventricle.volumes.sum(),
        mass=ventricle.volumes.sum() * case.tissue_density,
        tissue_density=case.tissue_density,
        flow=ventricle.flows.sum(),
        points=len(ventricle.points),
    )
    targets = PerfusionTargets(
        outlets=[outlet.name for outlet in outlets],
        bc=[outlet.bc for outlet in outlets],
        mean=mean,
        covariance=covariance,
        volume=volume,
        baseline=baseline,
        use=settings.use,
        branch_sd=settings.branch_sd,
        relative_sd=np.sqrt(np.diag(covariance)) / mean,
        further=further.covariances,
        rules=further.weights,
        realisations=settings.realisations,
        models=models,
        lv=lv,
        provenance=stamp(seed=seed, settings=settings.model_dump()),
    )
    write_json(out_json, targets.model_dump())


def _read(
    case_json: str | Path, lv_vtu: str | Path, settings: Settings
) -> tuple[CaseSummary, list[CaseOutlet], Ventricle, np.ndarray]:
    """Read the case, its LV-perfusing outlets and the ventricle; compute their weighted distances (points, outlets)."""
    case = read_case(case_json)
    outlets = perfusing_outlets(case, case_json)
    ventricle = Ventricle.read(lv_vtu, case.tissue_density)
    if settings.distance_to == "outlet":
        distances = distances_to_points(ventricle.points, [outlet.point for outlet in outlets])
    else:
        distances = distances_to_centrelines(ventricle.points, outlets, Path(case_json).with_name("tree.vtp"))
    return case, outlets, ventricle, weighted_distances(distances, outlets, settings.radius_power)


def _rules(case_json: str | Path, outlets: list[CaseOutlet], settings: Settings) -> dict[str, Distances]:
    """Return the published rules of territories by name, the campaign's own first."""
    places, tree = [outlet.point for outlet in outlets], Path(case_json).with_name("tree.vtp")

    def to_outlets(points: np.ndarray) -> np.ndarray:
        return distances_to_points(points, places)

    def to_centrelines(points: np.ndarray) -> np.ndarray:
        return distances_to_centrelines(points, outlets, tree)

    def own(points: np.ndarray) -> np.ndarray:
        plain = to_outlets(points) if settings.distance_to == "outlet" else to_centrelines(points)
        return weighted_distances(plain, outlets, settings.radius_power)

    if settings.distance_to == "outlet":
        return {"outlet": own, "centreline": to_centrelines}
    return {"centreline": own, "outlet": to_outlets}


def _join(chunks: Sequence[str | Path], settings: Settings) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], int]:
    """Return the flows and volumes of all realisations per model, in order of their index, and their seed."""
    parts = []
    for path in chunks:
        arrays = read_npz(path, ("first", "seed"))
        parts.append((int(arrays["first"]), path, arrays))
    parts.sort(key=lambda part: part[0])
    seeds = {int(arrays["seed"]) for _, _, arrays in parts}
    if len(seeds) != 1:
        raise InputError(chunks[0], "seed", sorted(seeds), "chunks of different seeds; delete them and run again")
    expected = 0
    for first, path, arrays in parts:
        if first != expected:
            raise InputError(path, "first", first, f"expected realisation {expected}: a chunk is missing or duplicated")
        for name in settings.models:
            if f"flow_{name}" not in arrays:
                raise InputError(path, f"flow_{name}", None, "not in this chunk; delete it and run again")
        expected += len(arrays[f"flow_{settings.use}"])
    if expected != settings.realisations:
        raise InputError(parts[-1][1], "realisations", expected, f"expected {settings.realisations} in all chunks")
    flows = {name: np.concatenate([arrays[f"flow_{name}"] for _, _, arrays in parts]) for name in settings.models}
    volumes = {name: np.concatenate([arrays[f"volume_{name}"] for _, _, arrays in parts]) for name in settings.models}
    return flows, volumes, seeds.pop()
