"""How far FFR and wall shear on a campaign's mesh are from those on a finer one: synthetic patients at several levels.

Each patient of the benchmark `endtoend` is run with its true lumen and true loop, eight lanes with different bed
resistances as in its truth, on the mesh of a configuration, on those of its mesh study, with its long time step, and at
the benchmark's truth. Patients are appended to a file as JSON lines and read from there; the summary is printed as
JSON: of the pressure loss 1 - FFR the relative error (mean, standard deviation, root mean square), of wall shear and
oscillation the ratio to the truth, per level; and over the lanes of one patient, how much of the error remains if it is
taken as constant, or as proportional to the quantity, from all lanes but one.

    python benchmarks/mesh_error.py FILE [--config smoke] [--seed 1] [--first 0] [--patients 12]   # CPU minutes each
"""

import argparse
import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from coronaryuq import config
from coronaryuq.bench.endtoend.patients import draw
from coronaryuq.bench.endtoend.truth import LEVELS, lanes
from coronaryuq.campaign import variants
from coronaryuq.case.anatomy.tree import write_tree
from coronaryuq.case.settings import Settings as CaseSettings
from coronaryuq.case.stage import prepare_case
from coronaryuq.core import records, shipped
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import write_csv
from coronaryuq.flow3d.adapter import Batch, Outputs
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.mesh.settings import Settings as MeshSettings
from coronaryuq.flow3d.mesh.stage import make_mesh
from coronaryuq.flow3d.settings import Settings as RunSettings
from coronaryuq.flow3d.stage import run_batch
from coronaryuq.synthetic.patient import write_case
from coronaryuq.synthetic.truth import patient_of
from coronaryuq.zerod.network.read import write_network

TRUTH = "truth"
KINDS = ("ffr_", "pressure_drop_", "tawss_mean_", "tawss_patch_min_", "osi_mean_", "osi_patch_max_")
"""Quantities, by the beginnings of their names; of FFR the loss is compared."""

Level = tuple[MeshSettings, RunSettings]


def levels(configuration: str) -> dict[str, Level]:
    """Return the levels of a configuration and the truth."""
    campaign = config.load(shipped.configuration(configuration))
    own = variants.own_settings(campaign) | {"fields": 0, "checkpoints": False}
    study = own | {"max_cycles": own["min_cycles"]}

    def mesh(scale: float) -> MeshSettings:
        return MeshSettings(**variants.scaled(campaign, scale))

    found = {"own": (mesh(1.0), RunSettings(**own))}
    for folder, scale in variants.STUDY.items():
        found[Path(folder).name] = (mesh(scale), RunSettings(**study))
    found["long_step"] = (mesh(1.0), RunSettings(**variants.longer_steps(study)))
    return found | {TRUTH: (LEVELS["default"].mesh, LEVELS["default"].runs)}


def patient(seed: int, index: int, of: Mapping[str, Level]) -> dict[str, Any] | None:
    """Return the outputs of every lane at every level; None for a patient without a stenosis."""
    drawn = draw(seed, index)
    if not drawn.lesions:
        return None
    plain = patient_of(drawn.true, drawn.settings, drawn.seed, drawn.physics)
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_case(plain, folder / "patient", "The truth.", {"viscosity": drawn.physics.viscosity})
        prepare_case(folder / "patient" / "case.yaml", CaseSettings(), folder / "case")
        case, tree, loop = folder / "case" / "case.json", folder / "case" / "tree.vtp", folder / "loop.json"
        write_tree(tree, drawn.true.tree)
        write_network(loop, plain.hyperaemia.network)
        write_csv(folder / "samples.csv", lanes(drawn))
        for name, (mesh, runs) in of.items():
            at = folder / name
            make_mesh(case, tree, loop, mesh, at)
            files = Outputs(folder / f"{name}.jsonl", folder / f"{name}-checkpoints")
            batch = Batch(case, loop, at / "mesh-complete", at / "mesh.json", folder / "samples.csv", 0, LANES, tree)
            run_batch(batch, "ensemble", runs, files)
            done = [row for row in records.read(files.records) if row.ok]
            outputs = {row.sample: {k: v for k, v in row.outputs.items() if k.startswith(KINDS)} for row in done}
            found[name] = {"nodes": read_json(at / "mesh.json")["nodes"], "outputs": outputs}
    return {"seed": seed, "index": index, "levels": found}


def summary(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """Return errors by kind and level, and what remains of them by lane."""
    found: dict[str, Any] = {"patients": len(lines), "kinds": {}}
    for kind in KINDS:
        errors: dict[str, list[float]] = {}
        left: list[tuple[float, float]] = []
        for line in lines:
            outputs = {name: level["outputs"] for name, level in line["levels"].items()}
            for quantity in next(iter(outputs[TRUTH].values()), {}):
                if not quantity.startswith(kind):
                    continue
                values = {name: _values(of_level, quantity) for name, of_level in outputs.items()}
                for name, of_level in values.items():
                    if name != TRUTH and "truth_0" in of_level and "truth_0" in values[TRUTH]:
                        errors.setdefault(name, []).append(of_level["truth_0"] / values[TRUTH]["truth_0"] - 1.0)
                common = sorted(set(values["own"]) & set(values[TRUTH]))
                if len(common) > 2:
                    left.append(_left(*(np.array([values[n][s] for s in common]) for n in ("own", TRUTH))))
        found["kinds"][kind] = {
            "stenoses": len(left),
            "relative_error": {name: _moments(np.array(values)) for name, values in errors.items()},
            "left_if_constant": float(np.median([one for one, _ in left])),
            "left_if_proportional": float(np.median([other for _, other in left])),
        }
    return found


def _values(outputs: Mapping[str, Mapping[str, float]], quantity: str) -> dict[str, float]:
    """Return lane → the quantity, of FFR the loss."""
    lost = quantity.startswith("ffr_")
    return {lane: 1.0 - row[quantity] if lost else row[quantity] for lane, row in outputs.items()}


def _moments(values: np.ndarray) -> dict[str, float]:
    rms = float(np.sqrt(np.mean(values**2)))
    return {"n": len(values), "mean": float(values.mean()), "sd": float(values.std()), "rms": rms}


def _left(own: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Return the mean square of what is left of the error of a lane, over its own, by a constant and by a factor."""
    error = truth - own
    constant, factor = (np.array([np.delete(e, i).mean() for i in range(len(e))]) for e in (error, error / own))
    square = np.mean(error**2)
    return float(np.mean((error - constant) ** 2) / square), float(np.mean((error - own * factor) ** 2) / square)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--config", default="smoke")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--patients", type=int, default=12)
    options = parser.parse_args()
    lines = [json.loads(line) for line in options.file.read_text().splitlines()] if options.file.exists() else []
    known = {(line["seed"], line["index"]) for line in lines}
    of = levels(options.config)
    for index in range(options.first, options.first + options.patients):
        if (options.seed, index) in known:
            continue
        try:
            line = patient(options.seed, index, of)
        except (ValueError, RuntimeError) as error:
            print(f"patient {index}: {error}")
            continue
        if line is not None:
            lines.append(line)
            with open(options.file, "a", encoding="utf-8") as file:
                file.write(json.dumps(line, default=float) + "\n")
    print(json.dumps(summary(lines), indent=1))


if __name__ == "__main__":
    main()
