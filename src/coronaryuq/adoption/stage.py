"""Rule functions of adoption: the network with what a search confirmed, and the prediction before and after."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from coronaryuq.adoption.choice import Choice, Placed, chosen
from coronaryuq.adoption.in_3d import for_3d, places_along
from coronaryuq.adoption.map_errors import readings_of_map, without_map_errors
from coronaryuq.adoption.network import with_effects
from coronaryuq.case.anatomy.tree import read_tree
from coronaryuq.case.case_json import CaseSummary, read_case
from coronaryuq.case.network.build import Physics
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.core.provenance import checksum
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.flow3d.mesh.description import read_description
from coronaryuq.perfusion.targets import read_perfusion_targets
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.read import read_network, write_network
from coronaryuq.zerod.settings import Settings as ZeroDSettings
from coronaryuq.zerod.stage import LoopModel, ffr_locations
from coronaryuq.zerod.theta import Theta, read_theta

QUANTILES = (0.05, 0.5, 0.95)


def adopt(
    case_json: str | Path, base_json: str | Path, searched_json: str | Path, answer_json: str | Path,
    residuals_csv: str | Path, measurements: str | Path, perfusion_json: str | Path, map_condition: str | None,
    network_json: str | Path, targets_json: str | Path, adoption_json: str | Path,
) -> None:  # fmt: skip
    """Write the campaign's network and target flows with what a search named and confirmed, and what was adopted.

    Parameters
    ----------
    case_json
        The case, whose 0D locations no effect may rename.
    base_json
        Network to be tuned, at rest: the case's, or that with losses learnt from 3D.
    searched_json
        The tuned loop at rest that was searched.
    answer_json, residuals_csv, measurements
        `discrepancy.json` and `residuals.csv` of the search, and the table that it searched.
    perfusion_json, map_condition
        Target flows of the perfusion stage, and the condition under which the table's perfusion is read from their map.
    network_json, targets_json
        Network and target flows to write: equal to those read if nothing is adopted.
    adoption_json
        What was adopted, why not, and where it is from.
    """
    answer, case = read_json(answer_json, ("named", "scales", "held_out")), read_case(case_json)
    choice = chosen(answer)
    source = _source(answer, measurements)
    base = read_network(base_json)
    adopted = with_effects(
        base, read_network(searched_json), choice.classes, answer["scales"], _locations(case), source
    )
    Theta(adopted.network, network_json)
    write_network(network_json, adopted.network)
    targets, readings = read_perfusion_targets(perfusion_json), None
    if map_condition is not None:
        readings = readings_of_map(_perfusion(residuals_csv), map_condition, targets.bc, measurements)
    corrected = without_map_errors(targets, choice.classes, readings)
    write_json(targets_json, corrected.targets.model_dump())
    became = adopted.refused | corrected.became
    classes = [_described(members, became, source) for members in choice.classes]
    write_json(adoption_json, _summary(choice, classes, answer) | {"targets_corrected": corrected.changed})


def in_3d(
    hyperaemia_json: str | Path, case_network_json: str | Path, mesh_json: str | Path, case_json: str | Path,
    tree_vtp: str | Path, stenosis_loss: float, out_json: str | Path, in_3d_json: str | Path,
) -> None:  # fmt: skip
    """Write the tuned loop for 3D runs, and which effects they have in the lumen and which not at all.

    Parameters
    ----------
    hyperaemia_json
        The tuned loop with what was adopted.
    case_network_json, case_json, tree_vtp
        The case: its own network, stenoses and lumen.
    mesh_json
        The mesh's description.
    stenosis_loss
        K_t of the stenosis law.
    out_json, in_3d_json
        The loop and the lists to write.
    """
    case, case_network, mesh = read_case(case_json), read_network(case_network_json), read_description(mesh_json)
    places = places_along(read_tree(tree_vtp), case.stenoses, case_network, mesh, str(case_network_json))
    physics = Physics(density=case.density, stenosis_loss=stenosis_loss)
    found = for_3d(read_network(hyperaemia_json), case_network, mesh, places, physics)
    write_network(out_json, found.network)
    write_json(in_3d_json, {"lumen": found.lumen, "refused": found.refused})


def predict(
    network_json: str | Path, case_json: str | Path, samples_csv: str | Path, settings: ZeroDSettings,
    out_csv: str | Path,
) -> None:  # fmt: skip
    """Run a table of θ through the 0D loop, and write the FFR of every sample."""
    count = len(read_csv(samples_csv, ("sample",)))
    model, names = LoopModel(network_json, case_json, settings), list(ffr_locations(read_case(case_json)))
    theta = read_theta(samples_csv, 0, count, model.network, network_json)
    batches = [model.run(theta.iloc[k : k + settings.batch]) for k in range(0, count, settings.batch)]
    runs = pd.concat(batches, ignore_index=True)
    write_csv(out_csv, runs[["sample", "status", *names]])


def compare(
    case_json: str | Path, adoption_json: str | Path, before_csv: str | Path,
    after_csv: str | Path, zones: Sequence[float], comparison_json: str | Path, in_3d_json: str | Path | None = None,
) -> None:  # fmt: skip
    """Write what was adopted beside the FFR of the 0D posterior predictive distribution before and after it.

    zones: rising limits of FFR between the zones whose probabilities are given; at or below the last lies the rest.
    """
    tables = {"before": read_csv(before_csv), "after": read_csv(after_csv)}
    names = {f"ffr_{stenosis.name.lower()}": stenosis.name for stenosis in read_case(case_json).stenoses}
    rows = [
        {"branch": branch, **{when: _predicted(table[column], zones) for when, table in tables.items()}}
        for column, branch in names.items()
    ]
    in_3d = read_json(in_3d_json, ("lumen", "refused")) if in_3d_json else {"lumen": {}, "refused": {}}
    content = read_json(adoption_json) | {"ffr": rows, "zones": list(zones)}
    content |= {"in_lumen": in_3d["lumen"], "not_in_3d": in_3d["refused"]}
    write_json(comparison_json, content | {"samples": {when: len(table) for when, table in tables.items()}})


def _predicted(values: pd.Series, zones: Sequence[float]) -> dict[str, Any]:
    ran = values.dropna().to_numpy(dtype=float)
    low, median, high = np.quantile(ran, QUANTILES).tolist()
    below = [float(np.mean(ran <= limit)) for limit in zones]
    return {
        "median": median, "low": low, "high": high,
        "zones": np.diff([0.0, *below, 1.0]).tolist(), "failed": int(values.isna().sum()),
    }  # fmt: skip


def _locations(case: CaseSummary) -> list[str]:
    """Return the locations that are read by name alone."""
    return [case.aorta.pressure]


def _perfusion(residuals_csv: str | Path) -> list[Measured]:
    """Return the measured mean perfusion, in the order of the search."""
    rows = read_csv(residuals_csv, ("measured", "sd"), ("condition", "quantity", "location", "statistic"))
    rows = rows[(rows["quantity"] == "perfusion") & (rows["statistic"] == "mean")]
    return [
        Measured(
            row.condition, row.quantity, row.location, row.statistic, None, 1.0,
            np.array([row.measured]), np.array([row.sd]),
        )
        for row in rows.itertuples()
    ]  # fmt: skip


def _source(answer: Mapping[str, Any], measurements: str | Path) -> str:
    count, held = answer["facts"]["measurements"], ", ".join(answer["held_out"]["conditions"])
    return (
        f"search of {count} fitted values of {Path(measurements).as_posix()} (SHA-256 {checksum(measurements)[:12]}); "
        f"held out: {held}"
    )


def _described(members: Sequence[Placed], refused: Mapping[str, str], source: str) -> dict[str, Any]:
    """Return a class as the page shows it."""
    rows = []
    for one in members:
        rows.append(
            {
                "effect": one.effect, "place": one.place, "probability": one.probability,
                "sizes": effect(one.effect).with_intervals(one.mean, one.covariance),
                "refused": refused.get(one.label, ""), "measurement": one.measurement,
            }
        )  # fmt: skip
    return {"members": rows, "source": source}


def _summary(choice: Choice, classes: list[dict[str, Any]], answer: Mapping[str, Any]) -> dict[str, Any]:
    acting = [one for entry in classes for one in entry["members"] if not one["refused"]]
    held = answer["held_out"]
    gap = {
        when: {"misfit": held[when]["misfit"], "interval_90": held[when]["interval_90"]} for when in ("before", "after")
    }
    return {
        "adopted": bool(acting), "reason": choice.reason, "classes": classes, "gap": gap,
        "held_out": held["conditions"], "scheme": held["scheme"],
    }  # fmt: skip
