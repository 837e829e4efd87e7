"""Rule function of the 3D stage: a batch of samples in, one record per sample out."""

from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.adapter import Adapter, Batch, FlowModel, Outputs, Processes
from coronaryuq.flow3d.ensemble.ensemble_adapter import EnsembleAdapter
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.simvascular.coupled_case import CoupledCase
from coronaryuq.flow3d.simvascular.svmultiphysics import SvMultiPhysics
from coronaryuq.flow3d.simvascular.svsolver import SvSolver
from coronaryuq.flow3d.umbridge import UmbridgeAdapter

SIMVASCULAR: dict[str, type[SvSolver] | type[SvMultiPhysics]] = {"svsolver": SvSolver, "svmultiphysics": SvMultiPhysics}


def run_batch(
    batch: Batch, solver: str, settings: Settings, outputs: Outputs, processes: Processes | None = None
) -> None:
    """Run a batch of samples in 3D and write one record per sample.

    Outputs: docs/explanation/architecture.md; cap flows in mL/s, pressures and stresses in dyn/cm2. Numbers
    do not depend on how the table is cut into batches or, for the ensemble solver, on the number of MPI ranks.

    Parameters
    ----------
    batch
        Rows of a table of θ, and the files of the model.
    solver
        `ensemble`, `svsolver`, `svmultiphysics` or `umbridge`.
    settings
        Of the 3D runs.
    outputs
        Where records, checkpoints and fields are written.
    processes
        MPI ranks, or launcher and tasks; one process by default.

    Raises
    ------
    InputError
        An input file is missing or malformed, or the solver is unknown.
    """
    model = batch.read_model()
    samples = batch.read_samples(model.network)
    make_adapter(solver, model, batch, settings, processes or Processes()).run(samples, outputs)


def make_adapter(solver: str, model: FlowModel, batch: Batch, settings: Settings, processes: Processes) -> Adapter:
    """Return the adapter of a 3D code."""
    if solver == "ensemble":
        return EnsembleAdapter(model, settings, processes.ranks)
    if solver == "umbridge":
        return UmbridgeAdapter(settings.umbridge)
    if solver not in SIMVASCULAR:
        raise InputError("configuration", "backend", solver, f"expected ensemble, umbridge, {' or '.join(SIMVASCULAR)}")
    external = settings.simvascular
    if processes.mpi is not None:
        external = external.model_copy(update={"mpi": processes.mpi})
    case = CoupledCase.of(model, batch.mesh_folder, external, settings.low_shear)
    return SIMVASCULAR[solver](case, processes.tasks)
