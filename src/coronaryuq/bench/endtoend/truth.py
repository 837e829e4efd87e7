"""The truth about a synthetic patient: the 3D model on the true lumen, coupled to the true loop.

One block of 3D runs serves twice. Its first lane is the patient: true FFR and wall shear. The other lanes, with other
bed resistances, teach the 0D vessels their losses, so that the flows from which the perfusion map is made are those of
the 3D model too.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.bench.endtoend.patients import PURPOSE, Drawn
from coronaryuq.case.anatomy.tree import write_tree
from coronaryuq.case.settings import Settings as CaseSettings
from coronaryuq.case.stage import prepare_case
from coronaryuq.core import records
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.seeds import generator
from coronaryuq.flow3d.adapter import Batch, Outputs
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.mesh.settings import Settings as MeshSettings
from coronaryuq.flow3d.mesh.stage import make_mesh
from coronaryuq.flow3d.settings import Settings as RunSettings
from coronaryuq.flow3d.stage import run_batch
from coronaryuq.losses.stage import learn_losses
from coronaryuq.synthetic.patient import write_case
from coronaryuq.synthetic.truth import Patient, bed_name, patient_of, with_vessels
from coronaryuq.zerod.network.beds import SCALING
from coronaryuq.zerod.network.read import write_network

SPREAD = 0.3
"""Standard deviation of the logarithm of the bed resistances in the lanes that teach."""


@dataclass(frozen=True)
class Level:
    """Accuracy of the 3D truth."""

    mesh: MeshSettings
    runs: RunSettings


def _level(finer: float, steps: int) -> Level:
    usual = MeshSettings()
    resolutions = ("throat_resolution", "resolution", "jet_resolution", "core_resolution")
    mesh = usual.model_copy(update={name: max(1.5, finer * getattr(usual, name)) for name in resolutions})
    return Level(mesh, RunSettings(steps_per_cycle=steps, max_cycles=4, checkpoints=False, fields=0))


LEVELS = {"default": _level(1.0, 800), "finer": _level(1.4, 1200)}
"""`default`: mesh and steps that campaigns have by default; a benchmark's campaign has those of `smoke`, coarser ones.
`finer`: to measure the error of `default`."""


@dataclass(frozen=True)
class Truth:
    """True quantities of a patient, the patient with the losses of 3D, and how far cheaper levels are from it.

    quantities: as 3D runs name them. ffr_0d, ffr_trained: stenosis → FFR by 0D with its own losses, and with those
    that the 3D runs taught.
    """

    quantities: dict[str, float]
    patient: Patient
    ffr_0d: dict[str, float]
    ffr_trained: dict[str, float]
    cpu_s: float


def find_truth(drawn: Drawn, level: Level) -> Truth:
    """Run the true patient in 3D.

    Raises
    ------
    InputError, ValueError, RuntimeError
        If the lumen cannot be meshed, or the patient's own run fails.
    """
    plain = patient_of(drawn.true, drawn.settings, drawn.seed, drawn.physics)
    with tempfile.TemporaryDirectory(prefix="truth-") as scratch:
        folder = Path(scratch)
        write_case(plain, folder / "patient", "The truth.", {"viscosity": drawn.physics.viscosity})
        prepare_case(folder / "patient" / "case.yaml", CaseSettings(), folder / "case")
        case, tree = folder / "case" / "case.json", folder / "case" / "tree.vtp"
        write_tree(tree, drawn.true.tree)
        rest, stressed = folder / "rest.json", folder / "hyperaemia.json"
        write_network(rest, plain.rest.network)
        write_network(stressed, plain.hyperaemia.network)
        make_mesh(case, tree, stressed, level.mesh, folder / "mesh")
        write_csv(folder / "samples.csv", lanes(drawn))
        mesh = folder / "mesh" / "mesh.json"
        batch = Batch(case, stressed, folder / "mesh" / "mesh-complete", mesh, folder / "samples.csv", 0, LANES, tree)
        runs = folder / "runs.jsonl"
        run_batch(batch, "ensemble", level.runs, Outputs(runs, folder / "checkpoints"))
        found = records.read(runs)
        if not found[0].ok:
            raise RuntimeError(f"the true patient does not run in 3D: {found[0].reason}")
        learn_losses(case, rest, stressed, mesh, runs, folder / "learnt.json", folder / "l.csv", folder / "fit.json")
        losses = read_json(folder / "fit.json", ("elements",))["elements"]
    trained = with_vessels(plain, losses, drawn.seed)
    cost = sum(record.cost["cpu_s"] for record in found)
    return Truth(found[0].outputs, trained, plain.hyperaemia.ffr, trained.hyperaemia.ffr, cost)


def lanes(drawn: Drawn) -> pd.DataFrame:
    """Return the inputs of a block: the patient, then other bed resistances."""
    beds = [bed_name(outlet.vessel) for outlet in drawn.true.outlets if outlet.perfuses == "LV"]
    random = generator(drawn.seed, PURPOSE, "teaching", drawn.index)
    factors = np.exp(SPREAD * random.standard_normal((LANES, len(beds) + 1)))
    factors[0] = 1.0
    table = pd.DataFrame(factors, columns=[*beds, SCALING])
    table.insert(0, "sample", [f"truth_{k}" for k in range(LANES)])
    return table
