"""Rule function: learn the losses of the 0D vessels from the records of 3D runs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from coronaryuq.case.case_json import read_case
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.records import read
from coronaryuq.flow3d.mesh.description import read_description
from coronaryuq.losses.fit import LossFit, fit_losses
from coronaryuq.losses.loop import LossLoop
from coronaryuq.losses.places import Place, edges, places
from coronaryuq.zerod.network.read import read_network, write_network

LEAST_RUNS = 3
"""Fewest 3D runs from which losses are learnt: two determine a linear and a quadratic loss, one more checks them."""


def learn_losses(
    case_json: str | Path, case_network_json: str | Path, hyperaemia_json: str | Path, mesh_json: str | Path,
    records_jsonl: str | Path, network_json: str | Path, losses_csv: str | Path, fit_json: str | Path,
) -> None:  # fmt: skip
    """Learn the losses of the 0D vessels from 3D runs, and write the case's network with them.

    Parameters
    ----------
    case_json, case_network_json
        The case, and its network at rest.
    hyperaemia_json
        The loop that the 3D runs were coupled to.
    mesh_json, records_jsonl
        The mesh's description and the records of the runs.
    network_json
        The case's network with the losses, to be tuned.
    losses_csv
        Table of the losses, one row per piece of the 3D domain.
    fit_json
        Errors before and after at every place, and the elements that were changed.

    Raises
    ------
    InputError
        If fewer than `LEAST_RUNS` 3D runs succeeded.
    """
    case, network, mesh = read_case(case_json), read_network(hyperaemia_json), read_description(mesh_json)
    runs = [record for record in read(records_jsonl) if record.ok]
    if len(runs) < LEAST_RUNS:
        remedy = f"fewer than {LEAST_RUNS} 3D runs succeeded; see their reasons, or set losses.runs_3d: 0"
        raise InputError(records_jsonl, "status", f"{len(runs)} ok", remedy)
    compared = places(network, mesh, case.stenoses)
    pieces = edges(network, mesh, compared)
    loop = LossLoop(network, compared, pieces, case.aorta.pressure, case.density, runs)
    measured = [[run.outputs[place.output] / run.outputs["aortic_pressure"] for place in compared] for run in runs]
    fit = fit_losses(loop.pressures, np.array(measured), loop.lowest)
    changed = loop.elements(fit.mean)
    corrected = read_network(case_network_json)
    for vessel, values in changed.items():
        corrected.vessel_values(vessel).update(values)
    write_network(network_json, corrected)
    write_csv(losses_csv, loop.table(fit))
    write_json(fit_json, _summary(fit, compared, len(runs)) | {"elements": changed, "own": loop.own})


def _summary(fit: LossFit, compared: Sequence[Place], runs: int) -> dict[str, Any]:
    """Return the root mean square errors of pressure over aortic pressure at each place; of a stenosis, that is FFR."""
    errors = {"before": fit.before, "after": fit.after, "left_out": fit.left_out}
    places_of = {
        place.name: {name: float(np.sqrt(np.mean(error[:, column] ** 2))) for name, error in errors.items()}
        for column, place in enumerate(compared)
    }
    return {"runs": runs, "rms": places_of}
