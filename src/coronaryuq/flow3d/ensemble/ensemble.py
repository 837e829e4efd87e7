"""The ensemble solver: all samples of one mesh, block after block; those that blow up again with shorter steps."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from coronaryuq.flow3d.adapter import FlowModel
from coronaryuq.flow3d.ensemble.block import Block, Outcome, Report, Task
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.lanes import LANES
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
            for first in range(0, len(pending), LANES):
                members = pending[first : first + LANES]
                task = Task(
                    changes={name: value[members] for name, value in changes.items()},
                    samples=len(members),
                    refinement=refinement,
                    checkpoint=checkpoint and checkpoint.with_name(f"{checkpoint.name}_{refinement}_{members[0]}.npz"),
                    fields=any(wanted[k] for k in members),
                    label=f"{members[0] + 1} to {members[-1] + 1} of {samples}",
                    waveforms=waveforms,
                    start=None if start is None else np.asarray(start, float)[members],
                    shapes=None if shapes is None else shapes.of(members),
                )
                space = self.space(refinement) if shapes is None else self.own_spaces(refinement, shapes.of(members))
                block = Block(self.model, self.settings, space, task, report)
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
            self._spaces[refinement] = self._discretised(refinement, domain.points, model.viscosity)
        return self._spaces[refinement]

    def own_spaces(self, refinement: int, shapes: Shapes) -> Discretisation:
        """Return operators of up to LANES samples with lumens and blood of their own, the last one repeated."""
        spaces = [
            self._discretised(refinement, points, float(viscosity))
            for points, viscosity in zip(shapes.points, shapes.viscosity, strict=True)
        ]
        return Discretisation.of_lanes(spaces + [spaces[-1]] * (LANES - len(spaces)), self.space(refinement))

    def _discretised(self, refinement: int, points: np.ndarray, viscosity: float) -> Discretisation:
        domain, model = self.model.domain, self.model
        step = model.engine.model.period / (self.settings.steps_per_cycle * 2**refinement)
        return Discretisation(points, domain.tets, domain.caps, domain.inlets, step, model.density, viscosity)


def _add_earlier(outcome: Outcome, earlier: Outcome) -> None:
    """Add cost and reason of the failed run with longer steps."""
    outcome.cpu_s += earlier.cpu_s
    outcome.wall_s += earlier.wall_s
    outcome.earlier_failures = [*earlier.earlier_failures, earlier.reason]
