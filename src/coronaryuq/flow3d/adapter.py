"""The one interface of the 3D codes: a batch of samples in, one record per sample out.

To add a code, write a class with `Adapter.run` and name it in `flow3d.stage.make_adapter`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np

from coronaryuq.case.anatomy.tree import Tree, placed_stenoses, read_tree
from coronaryuq.case.case_json import CaseSummary, read_case
from coronaryuq.case.lowest_ffr import FfrPlaces, ffr_places
from coronaryuq.case.lumen.profiles import Lumen, lumen_of
from coronaryuq.case.network.network import LUMEN, NARROWED, VISCOSITY, Network
from coronaryuq.core.errors import InputError
from coronaryuq.core.ranks import Ranks
from coronaryuq.flow3d.mesh.coupling.cut_network import CutNetwork, cut_network
from coronaryuq.flow3d.mesh.morph.morph import Morph
from coronaryuq.flow3d.mesh.read_mesh import Domain, read_domain
from coronaryuq.flow3d.mesh.remesh import Remesher
from coronaryuq.flow3d.narrowed_lumen import narrowed_lumen
from coronaryuq.flow3d.shapes import Meshes, Shapes, draw_shapes
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.theta import read_theta


@dataclass(frozen=True)
class Sample:
    """One row of the table of inputs: its name, its row number in the table, and θ by column."""

    name: str
    row: int
    theta: Mapping[str, float]


@dataclass(frozen=True)
class FlowModel:
    """What all samples share: the mesh in its 0D loop.

    Parameters
    ----------
    domain
        The mesh.
    network
        The tuned closed loop (svZeroDSolver JSON).
    aorta
        0D connection `A:B` whose mean pressure FFR divides by.
    density, viscosity
        Of blood, g/cm3 and poise.
    tree
        The lumen that the mesh was made from; needed if the network's lumen is uncertain or narrowed.
    case
        The case, whose arteries have a lowest FFR each; None where that is not asked for.
    """

    domain: Domain
    network: Network
    aorta: str
    density: float
    viscosity: float
    tree: Tree | None = field(default=None, kw_only=True)
    case: CaseSummary | None = field(default=None, kw_only=True)

    @cached_property
    def engine(self) -> Engine:
        """The 0D engine of the full loop."""
        return Engine(self.network)

    @cached_property
    def coupled(self) -> CutNetwork:
        """The 0D side without the 3D domain."""
        return cut_network(self.network, self.domain.description)

    @cached_property
    def lumen(self) -> Lumen | None:
        """The lumen that differs between samples; None if all have the mesh's."""
        if NARROWED in self.network:
            assert self.tree is not None  # read_model checks that there is a tree
            return narrowed_lumen(self.network, self.tree)
        return lumen_of(self.network)

    @cached_property
    def _meshes(self) -> Meshes | None:
        if self.lumen is None:
            return None
        assert self.tree is not None  # read_model checks that there is a tree
        stenoses = [] if self.case is None else placed_stenoses(self.case.stenoses)
        remesher = Remesher(self.domain, self.tree, stenoses, self.lumen)
        return Meshes(Morph(self.domain, self.tree, self.lumen), remesher)

    def shapes(self, theta: Mapping[str, np.ndarray], samples: int) -> Shapes | None:
        """Return lumens and viscosities of samples from columns (samples,) of θ; None if they share the mesh's."""
        if self.lumen is None and VISCOSITY not in theta:
            return None
        factor = np.broadcast_to(np.asarray(theta.get(VISCOSITY, 1.0), float), (samples,))
        return draw_shapes(self.domain, self._meshes, self.viscosity * factor, theta, samples)

    @cached_property
    def ffr_places(self) -> dict[str, FfrPlaces]:
        """Where the lowest FFR of each artery is sought; its ends are pressures of the coupled 0D side."""
        return {} if self.case is None else ffr_places(self.case, Model(self.coupled.network).variables)

    @property
    def aortic_pressure(self) -> str:
        """Unknown of the coupled 0D side that is the aortic pressure."""
        return self.coupled.in_cut_network(f"pressure:{self.aorta}")


@dataclass(frozen=True)
class Batch:
    """Rows `first` to `first + count` of a table of θ, and the files of the model that they are run on.

    Parameters
    ----------
    case
        `case.json`.
    network
        The tuned loop at hyperaemia, svZeroDSolver JSON.
    mesh_folder, mesh
        `mesh-complete/` and `mesh.json`.
    samples
        CSV with `sample`, one column per coronary bed (multiplier of r-hat), `R_cor_scaling`, and one per uncertain
        parameter of the network.
    first, count
        Rows to run, from 0.
    tree
        `tree.vtp`, the lumen that the mesh was made from; needed if the network's lumen is uncertain or narrowed.
    """

    case: str | Path
    network: str | Path
    mesh_folder: str | Path
    mesh: str | Path
    samples: str | Path
    first: int
    count: int
    tree: str | Path | None = None

    def read_model(self) -> FlowModel:
        """Read what all samples share; `InputError` names the file at fault."""
        case = read_case(self.case)
        network, domain = read_network(self.network), read_domain(self.mesh_folder, self.mesh)
        changed = next((part for part in (LUMEN, NARROWED) if part in network), None)
        if changed and self.tree is None:
            raise InputError(self.network, changed, None, "samples have their own lumen: give the case's tree.vtp, too")
        tree = read_tree(self.tree) if changed and self.tree is not None else None
        return FlowModel(domain, network, case.aorta.pressure, case.density, case.viscosity, tree=tree, case=case)

    def read_samples(self, network: Network) -> list[Sample]:
        """Read the batch's rows; `InputError` for too few rows or a column that is not a coronary bed."""
        theta = read_theta(self.samples, self.first, self.count, network, self.network)
        columns = [name for name in theta.columns if name != "sample"]
        return [
            Sample(str(theta["sample"].iloc[k]), self.first + k, {name: float(theta[name].iloc[k]) for name in columns})
            for k in range(self.count)
        ]


@dataclass(frozen=True)
class Outputs:
    """Where a batch writes: records, state to resume from, fields for pictures (None: no fields)."""

    records: Path
    checkpoints: Path
    fields: Path | None = None


@dataclass(frozen=True)
class Processes:
    """How a batch is spread: MPI ranks of this job (ensemble), or MPI launcher and tasks per run (external codes).

    mpi: None takes the launcher from the settings.
    """

    ranks: Ranks = field(default_factory=Ranks)
    mpi: str | None = None
    tasks: int = 1


class Adapter(Protocol):
    """A 3D code."""

    def run(self, samples: Sequence[Sample], outputs: Outputs) -> None:
        """Run samples, resume from `outputs.checkpoints`, and write one record per sample, in order.

        A sample that fails ends as a failed record with its reason; it never stops the batch. A sample's numbers do
        not depend on the others in the batch.
        """
        ...
