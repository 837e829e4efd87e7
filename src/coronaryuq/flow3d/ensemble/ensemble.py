"""The ensemble solver: all samples of one mesh, block after block; those that blow up again with shorter steps.

A sample with a mesh of its own is a block of its own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from coronaryuq.flow3d.adapter import FlowModel
from coronaryuq.flow3d.ensemble.block import Block, Outcome, Report, Task
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.mesh.read_mesh import Domain
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.shapes import Shapes


class Ensemble:
    """All samples of one mesh and one network.

    Parameters
    ----------
    model
        The mesh in its 0D loop.
    settings
        Steps, cycles and tolerances.
    """

    def __init__(self, model: FlowModel, settings: Settings):
        self.model, self.settings = model, settings
        self._spaces: dict[int, Discretisation] = {}

    def run(
        self,
        changes: Mapping[str, np.ndarray],
        samples: int,
        checkpoint: Path | None = None,
        fields: Sequence[bool] | None = None,
        report: Report | None = None,
        waveforms: Sequence[str] = (),
        start: np.ndarray | None = None,
        shapes: Shapes | None = None,
    ) -> list[Outcome]:
        """Run samples in blocks of LANES; a sample's numbers do not depend on its block.

        Parameters
        ----------
        changes
            "BLOCK.parameter" of the network → (samples,) values.
        samples
            Number of samples.
        checkpoint
            Stem of the files that keep each block's state from cycle to cycle; None: none.
        fields
            (samples,) whether a sample's fields are wanted.
        report
            Called with the block and the fraction of its cycle done, every few steps.
        waveforms
            Unknowns of the full network, such as `pressure:A:B`, whose last cycle is wanted.
        start
            (samples, unknowns) where the search for the periodic 0D states begins: a closed loop keeps the blood that
            it starts with.
        shapes
            Lumens of the samples; None: all have the mesh's.

        Returns
        -------
        list of Outcome
            One per sample, in order. A sample that fails is an outcome with a reason, never an exception.
        """
        changes = {name: np.broadcast_to(np.asarray(value, float), (samples,)) for name, value in changes.items()}
        wanted = [False] * samples if fields is None else list(fields)
        outcomes: dict[int, Outcome] = {}
        pending = list(range(samples))
        if shapes is not None:
            outcomes |= {k: Outcome(reason=reason) for k, reason in enumerate(shapes.reasons) if reason}
            pending = [k for k in pending if k not in outcomes]
        for refinement in range(self.settings.refinements + 1):
            failed = []
            for members in _blocks(pending, shapes):
                model, space, own = self._geometry(refinement, members, shapes)
                task = Task(
                    changes={name: value[members] for name, value in changes.items()},
                    samples=len(members),
                    refinement=refinement,
                    checkpoint=checkpoint and checkpoint.with_name(f"{checkpoint.name}_{refinement}_{members[0]}.npz"),
                    fields=any(wanted[k] for k in members),
                    label=f"{members[0] + 1} to {members[-1] + 1} of {samples}",
                    waveforms=waveforms,
                    start=None if start is None else np.asarray(start, float)[members],
                    shapes=own,
                )
                block = Block(model, self.settings, space, task, report)
                for k, outcome in zip(members, block.run(), strict=True):
                    if k in outcomes:
                        _add_earlier(outcome, outcomes[k])
                    if not wanted[k]:
                        outcome.fields = {}
                    outcomes[k] = outcome
                    if not outcome.ok and outcome.retry:
                        failed.append(k)
            pending = failed
            if not pending:
                break
        return [outcomes[k] for k in range(samples)]

    def space(self, refinement: int) -> Discretisation:
        """Return the mesh's operators for the time step of a refinement."""
        if refinement not in self._spaces:
            domain, model = self.model.domain, self.model
            self._spaces[refinement] = self._discretised(domain, refinement, domain.points, model.viscosity)
        return self._spaces[refinement]

    def own_spaces(self, refinement: int, shapes: Shapes) -> Discretisation:
        """Return operators of up to LANES samples with lumens and blood of their own, the last one repeated."""
        spaces = [
            self._discretised(self.model.domain, refinement, points, float(viscosity))
            for points, viscosity in zip(shapes.points, shapes.viscosity, strict=True)
        ]
        return Discretisation.of_lanes(spaces + [spaces[-1]] * (LANES - len(spaces)), self.space(refinement))

    def _geometry(
        self, refinement: int, members: list[int], shapes: Shapes | None
    ) -> tuple[FlowModel, Discretisation, Shapes | None]:
        """Return the model of a block, the operators on its mesh, and its lumens."""
        if shapes is None:
            return self.model, self.space(refinement), None
        first = members[0]
        if first not in shapes.remeshed:
            own = shapes.of(members)
            return self.model, self.own_spaces(refinement, own), own
        own, domain = shapes.alone(first), shapes.remeshed[first].domain
        space = self._discretised(domain, refinement, domain.points, float(own.viscosity[0]))
        return replace(self.model, domain=domain), space, own

    def _discretised(self, domain: Domain, refinement: int, points: np.ndarray, viscosity: float) -> Discretisation:
        step = self.model.engine.model.period / (self.settings.steps_per_cycle * 2**refinement)
        return Discretisation(points, domain.tets, domain.caps, domain.inlets, step, self.model.density, viscosity)


def _blocks(pending: list[int], shapes: Shapes | None) -> list[list[int]]:
    """Return the samples of each block: LANES on the common mesh, or one that has a mesh of its own."""
    alone = [] if shapes is None else [k for k in pending if k in shapes.remeshed]
    common = [k for k in pending if k not in alone]
    return [common[first : first + LANES] for first in range(0, len(common), LANES)] + [[k] for k in alone]


def _add_earlier(outcome: Outcome, earlier: Outcome) -> None:
    """Add cost and reason of the failed run with longer steps."""
    outcome.cpu_s += earlier.cpu_s
    outcome.wall_s += earlier.wall_s
    outcome.earlier_failures = [*earlier.earlier_failures, earlier.reason]
