"""Mesh study: the numerical error of every quantity of interest, from a few samples run again on other levels."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from coronaryuq.core import provenance, records
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.io.typed import checked, plain
from coronaryuq.core.records import Record
from coronaryuq.flow3d.numerical_error import NumericalError, Source, numerical_error

UNITS = {
    "ffr_": "1",
    "lowest_ffr_": "1",
    "pressure_drop_": "mmHg",
    "tawss_": "dyn/cm2",
    "osi_": "1",
    "low_shear_": "1",
}
"""Beginnings of the names of the quantities of interest, and their units."""

Values = dict[str, np.ndarray]
"""Quantity → its values (level, sample), coarsest level first."""


@dataclass(frozen=True)
class MeshRuns:
    """A mesh (`mesh.json`) and the files of records of the samples run on it."""

    mesh: str | Path
    records: Sequence[str | Path]

    @property
    def nodes(self) -> int:
        return read_json(self.mesh, ("nodes",))["nodes"]

    def finished(self) -> dict[str, Record]:
        """Return the records of the samples that were finished, by sample."""
        return {row.sample: row for path in self.records for row in records.read(path) if row.ok}


class NotMeasured(Exception):
    """Why the error from one source cannot be told from the runs."""


@dataclass(frozen=True)
class _Levels:
    """Runs of the same samples on several levels. size: (k,) coarsest first; own: index of the campaign's level."""

    size: np.ndarray
    values: Values
    samples: list[str]
    own: int


def mesh_study(
    own: MeshRuns, others: Sequence[MeshRuns], long_step: MeshRuns | None, cost: Mapping[str, float],
    out_json: str | Path,
) -> dict[str, Any]:  # fmt: skip
    """Estimate the numerical error of every quantity of interest, and write it.

    Parameters
    ----------
    own
        The campaign's mesh, and records of its samples.
    others
        Coarser and finer meshes with records of some of these samples; may be empty.
    long_step
        Records of some of these samples on the campaign's mesh with longer time steps, if there are any.
    cost
        What the study has cost, for the file.
    out_json
        Where the result is written.

    Returns
    -------
    dict
        What was written (docs/reference/formats.md); read it with `read_discretization`. `checksum` is that of the
        campaign's `mesh.json`, so that a reader can tell whether the study is of the mesh at hand.
    """
    done = own.finished()
    sources: dict[Source, Callable[[], _Levels]] = {
        "mesh": lambda: _meshes(own, others),
        "time_step": lambda: _time_steps(done, long_step),
        "cycles": lambda: _cycles(done),
    }
    found: dict[Source, _Levels] = {}
    missing: dict[str, str] = {}
    for source, levels in sources.items():
        try:
            found[source] = levels()
        except NotMeasured as reason:
            missing[source] = str(reason)
    names = {name: None for levels in found.values() for name in levels.values}
    content = {
        "checksum": provenance.checksum(own.mesh),
        "nodes": sorted(mesh.nodes for mesh in (own, *others)),
        "cost": dict(cost),
        "not_measured": missing,
        "quantities": {name: _quantity(name, found) for name in names},
    }
    write_json(out_json, content)
    return content


def read_discretization(path: str | Path) -> dict[str, list[NumericalError]]:
    """Read the numerical errors of every quantity, one per source that was measured.

    Raises
    ------
    InputError
        If the file is missing or malformed.
    """
    quantities = read_json(path, ("quantities",))["quantities"]
    return {name: checked(list[NumericalError], value["errors"], path) for name, value in quantities.items()}


def compare(meshes: Sequence[MeshRuns]) -> tuple[list[int], list[int], list[str], Values]:
    """Collect the quantities of interest of the samples that every mesh has.

    Returns
    -------
    tuple
        Indices of the meshes, coarsest first; their numbers of nodes; the common samples; the values.

    Raises
    ------
    NotMeasured
        No sample was finished on every mesh, or two meshes are equally fine.
    """
    count = [mesh.nodes for mesh in meshes]
    order = sorted(range(len(meshes)), key=count.__getitem__)
    nodes = [count[k] for k in order]
    if len(set(nodes)) < len(nodes):
        raise NotMeasured("the meshes are equally fine; an imported mesh folder cannot be refined")
    samples, values = _paired([meshes[k].finished() for k in order])
    return order, nodes, samples, values


def _quantity(name: str, found: Mapping[Source, _Levels]) -> dict[str, Any]:
    levels = {source: level for source, level in found.items() if name in level.values}
    return {
        "unit": next(unit for start, unit in UNITS.items() if name.startswith(start)),
        "means": {source: level.values[name].mean(axis=1).tolist() for source, level in levels.items()},
        "errors": [
            plain(numerical_error(source, level.size, level.values[name], level.own))
            for source, level in levels.items()
        ],
    }  # fmt: skip


def _meshes(own: MeshRuns, others: Sequence[MeshRuns]) -> _Levels:
    if not others:
        raise NotMeasured("no other mesh was run")
    order, nodes, samples, values = compare([own, *others])
    return _Levels(np.array(nodes, float) ** (-1 / 3), values, samples, order.index(0))


def _time_steps(own: Mapping[str, Record], long_step: MeshRuns | None) -> _Levels:
    """Return runs with long and with the campaign's steps; samples that needed shorter ones are left out."""
    if long_step is None:
        raise NotMeasured("no other time step was run")
    levels: list[dict[str, Record]] = []
    steps: list[int] = []
    for done in (long_step.finished(), own):
        counts = {name: int(str(row.diagnostics.get("steps_per_cycle", 0))) for name, row in done.items()}
        steps.append(min(counts.values(), default=0))
        levels.append({name: row for name, row in done.items() if counts[name] == steps[-1]})
    if not 0 < steps[0] < steps[1]:
        raise NotMeasured("no sample was finished with longer time steps")
    samples, values = _paired(levels)
    return _Levels(1.0 / np.array(steps, float), values, samples, 1)


def _cycles(own: Mapping[str, Record]) -> _Levels:
    """Return the last cycles of the campaign's runs: three, or two if some samples have no more."""
    earlier = {name: row.diagnostics.get("earlier_cycles") for name, row in own.items()}
    kept: dict[str, dict[str, list[float]]] = {n: cycles for n, cycles in earlier.items() if isinstance(cycles, dict)}
    samples = [name for name, cycles in kept.items() if cycles and all(cycles.values())]
    if not samples:
        raise NotMeasured("the records hold no earlier cycles")
    fewest = min(len(values) for name in samples for values in kept[name].values())
    size = np.array([4.0, 2.0, 1.0])[-min(fewest + 1, 3) :]
    values = {
        quantity: np.array([[*kept[name][quantity], own[name].outputs[quantity]][-len(size) :] for name in samples]).T
        for quantity in kept[samples[0]]
        if quantity.startswith(tuple(UNITS))
    }
    return _Levels(size, values, samples, len(size) - 1)


def _paired(levels: Sequence[Mapping[str, Record]]) -> tuple[list[str], Values]:
    """Return the samples that every level has, and their values after the same number of cycles where these are kept.

    Raises `NotMeasured` if there is none.
    """
    common = sorted(set.intersection(*(set(done) for done in levels)))
    if not common:
        raise NotMeasured("no sample was finished on every level; see the records' reasons")
    fewest = {name: min(done[name].cost.get("cycles", 0) for done in levels) for name in common}
    names = sorted(name for name in levels[0][common[0]].outputs if name.startswith(tuple(UNITS)))
    return common, {
        quantity: np.array([[_after(done[name], int(fewest[name]), quantity) for name in common] for done in levels])
        for quantity in names
    }


def _after(record: Record, cycles: int, quantity: str) -> float:
    """Return a quantity after a number of cycles, or after the last if the record does not hold that one."""
    earlier = record.diagnostics.get("earlier_cycles")
    kept = earlier.get(quantity, []) if isinstance(earlier, dict) else []
    return kept[cycles - 1] if 0 < cycles <= len(kept) else record.outputs[quantity]
