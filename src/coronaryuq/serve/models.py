"""The models of a campaign that are served: from θ to quantities of interest, many samples at once."""

import tempfile
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd

from coronaryuq.campaign.results import ResultsFolder
from coronaryuq.campaign.targets import Targets
from coronaryuq.campaign.variants import loop_in_3d, runs_3d
from coronaryuq.case.case_json import read_case
from coronaryuq.case.lowest_ffr import ffr_places
from coronaryuq.core import records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_csv
from coronaryuq.flow3d.adapter import Batch, Outputs, Processes, Sample
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.mesh.description import read_description
from coronaryuq.flow3d.quantities import WallRegion, stenosis_quantities
from coronaryuq.flow3d.settings import Settings as Flow3DSettings
from coronaryuq.flow3d.stage import make_adapter
from coronaryuq.posterior.model.bed_flows import BedFlows
from coronaryuq.posterior.model.flow_model import Response, respond
from coronaryuq.posterior.model.likelihood import likelihood_of
from coronaryuq.posterior.model.tissue import PerGram
from coronaryuq.posterior.reading import Reading
from coronaryuq.posterior.results import Chains
from coronaryuq.zerod.network.beds import SCALING
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.stage import LoopModel
from coronaryuq.zerod.theta import Theta

NOT_INPUTS = ("chain", "generation", "log_density", SCALING)


class ServedModel(Protocol):
    """A model with one vector of inputs and one of outputs.

    Attributes
    ----------
    name
        Name by which clients request it.
    inputs, outputs
        Names of the components.
    signed
        Inputs that may have any sign: uncertain parameters of the network. All others are positive factors.
    lanes
        Number of samples that it runs together.
    """

    name: str
    lanes: int
    signed: list[str]

    @property
    def inputs(self) -> list[str]: ...

    @property
    def outputs(self) -> list[str]: ...

    def run(self, theta: np.ndarray) -> list[list[float] | str]:
        """Run inputs (n, inputs), n ≤ lanes; return per row the outputs, or the reason for their absence."""
        ...


def inputs_of(files: ResultsFolder) -> list[str]:
    """Return the multipliers and uncertain parameters of θ, in the order of the tables of θ."""
    draws = read_csv(files.path("posterior", "draws.csv"), ("chain",))
    return [str(name) for name in draws.columns if name not in NOT_INPUTS]


class ZeroD:
    """θ → the quantities of the 0D stage, with its settings."""

    name = "zerod"

    def __init__(self, files: ResultsFolder):
        settings = files.configuration.zerod
        self._model = LoopModel(files.path("calibration", "hyperaemia.json"), files.path("case", "case.json"), settings)
        self.inputs, self.outputs, self.lanes = [*inputs_of(files), SCALING], self._model.outputs, settings.batch
        self.signed = self._model.theta.laws.names

    def run(self, theta: np.ndarray) -> list[list[float] | str]:
        table = pd.DataFrame(theta, columns=self.inputs)
        table.insert(0, "sample", [str(k) for k in range(len(theta))])
        done = self._model.run(table)
        rows = done[self.outputs].to_numpy(dtype=float)
        return [
            row.tolist() if status == records.OK else str(reason)
            for row, status, reason in zip(rows, done["status"], done["reason"], strict=True)
        ]


class LogLikelihood:
    """Multipliers of r-hat and uncertain parameters → log likelihood of the target flows as the sampler has it."""

    name, outputs = "loglikelihood", ["log_likelihood"]

    def __init__(self, files: ResultsFolder):
        settings = files.configuration.posterior
        chains = Chains.read(files.path("posterior", "length_1", "chains.npz"))
        vessels = {outlet.bc: outlet.vessel for outlet in read_case(files.path("case", "case.json")).outlets}
        # Where the total resistance was inferred, it is an input.
        further = [name for name in PerGram.further if name in chains.parameter_names]
        self._flows = BedFlows(
            files.path("calibration", "hyperaemia.json"),
            {bed: vessels[bed] for bed in chains.names},
            tolerance=settings.cycle_tolerance,
            steps_per_cycle=settings.steps_per_cycle,
            further=further,
        )
        self._likelihood = likelihood_of(chains)
        self._reading = Reading(chains.reading_gain, chains.reading_centre) if further else None
        self._laws = self._flows.theta.laws
        self._response: Response | None = None
        self.signed, self.inputs = self._laws.names, [*chains.names, *further, *self._laws.names]
        self.lanes = files.configuration.zerod.batch
        if self.signed and settings.scale_targets and not further:
            at_r_hat = self._flows.flows(np.ones((1, len(chains.names))))[0]
            self._response = respond(self._flows, self._laws, at_r_hat)

    def run(self, theta: np.ndarray) -> list[list[float] | str]:
        flows = self._flows.flows(theta)
        if self._response is not None:
            z = self._laws.coordinates(theta[:, -len(self._laws) :])
            flows = flows / np.exp(self._response.log_total(self._laws.stepped(z)))[:, None]
        if self._reading is not None:
            beds = flows.shape[1]
            flows = flows * self._reading.over_flow(theta[:, :beds] * theta[:, beds : beds + 1])
        failed = ~np.isfinite(flows).all(axis=1)
        values = self._likelihood.log_density(np.where(failed[:, None], 0.0, flows))
        return ["the 0D run failed" if bad else [float(v)] for bad, v in zip(failed, values, strict=True)]


class Flow3D:
    """θ → what 3D runs measure, by the campaign's solver.

    FFR, pressure drop and wall shear stress of every stenosis, and the lowest FFR of every artery.

    Parameters
    ----------
    files
        The campaign.
    name
        Name of the model.
    run
        Kind of 3D runs, `flow3d` or `coarse`.
    """

    def __init__(self, files: ResultsFolder, name: str, run: str):
        kind = runs_3d(Targets(files.configuration))[run]
        self.name, self.inputs = name, [*inputs_of(files), SCALING]
        self._settings = Flow3DSettings(**kind.settings | {"checkpoints": False, "fields": 0})
        self._backend = files.configuration.backend
        mesh_json = files.path(kind.mesh, "mesh.json")
        loop = files.path(*loop_in_3d(files.configuration, in_3d=True))
        network = read_network(loop)
        self.signed = Theta(network, loop).laws.names
        self._batch = Batch(
            files.path("case", "case.json"), loop,
            files.path(kind.mesh, "mesh-complete"), mesh_json, "", 0, 0, files.path("case", "tree.vtp"),
        )  # fmt: skip
        one, triangle = np.ones(1), WallRegion.of(np.eye(3), np.array([[0, 1, 2]]), np.arange(3))
        shear, mesh = np.ones((3, 1)), read_description(mesh_json)
        before = {name: one if name in mesh.proximal_planes else None for name in mesh.regions}
        arteries = ffr_places(read_case(files.path("case", "case.json")), Model(network).variables)
        self.outputs = [
            *(
                name
                for stenosis in mesh.regions
                for name in stenosis_quantities(stenosis, one, one, shear, shear, triangle, 1.0, before[stenosis])
            ),
            "aortic_pressure",
            *(f"lowest_ffr_{artery.lower()}" for artery in arteries),
        ]
        self.lanes = LANES if self._backend == "ensemble" else 1

    @cached_property
    def _model(self) -> Any:
        return self._batch.read_model()

    def run(self, theta: np.ndarray) -> list[list[float] | str]:
        samples = [
            Sample(f"request_{k}", k, dict(zip(self.inputs, map(float, row), strict=True)))
            for k, row in enumerate(theta)
        ]
        with tempfile.TemporaryDirectory() as folder:
            outputs = Outputs(Path(folder, "records.jsonl"), Path(folder, "checkpoints"))
            make_adapter(self._backend, self._model, self._batch, self._settings, Processes()).run(samples, outputs)
            found = records.read(outputs.records)
        return [[record.outputs[name] for name in self.outputs] if record.ok else record.reason for record in found]


def models_of(home: str | Path) -> tuple[list[ServedModel], list[InputError]]:
    """Return the models of a campaign, and the missing files of those that cannot be served yet.

    Parameters
    ----------
    home
        Results folder, `results/NAME`.

    Raises
    ------
    InputError
        If the folder is not that of a campaign.
    """
    files = ResultsFolder(Path(home))
    _ = files.configuration
    makers: Sequence[Callable[[], ServedModel]] = (
        lambda: ZeroD(files),
        lambda: LogLikelihood(files),
        lambda: Flow3D(files, "flow3d", "flow3d"),
        lambda: Flow3D(files, "flow3d_coarse", "coarse"),
    )
    found: list[ServedModel] = []
    missing: list[InputError] = []
    for make in makers:
        try:
            found.append(make())
        except InputError as error:
            missing.append(error)
    return found, missing
