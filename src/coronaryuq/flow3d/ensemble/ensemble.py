"""The ensemble solver: all samples of one mesh, block after block, and again on shorter steps what blew up."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from coronaryuq.flow3d.ensemble.block import Block, Outcome
from coronaryuq.flow3d.ensemble.coupled_network import couple
from coronaryuq.flow3d.ensemble.geometry import Geometry
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.settings import Settings
from coronaryuq.zerod.network.read import Network
from coronaryuq.zerod.solver.engine import Engine


class Ensemble:
    """All samples of one mesh and one network.

    network: the tuned closed loop (svZeroDSolver JSON). aorta: 0D location `A:B` whose mean pressure FFR divides by.
    """

    def __init__(
        self, geometry: Geometry, network: Network, aorta: str, density: float, viscosity: float, settings: Settings
    ):
        self.geometry, self.network, self.settings = geometry, network, settings
        self.density, self.viscosity = density, viscosity
        self.engine = Engine(network)
        self.case = couple(network, geometry.description)
        self.aorta = self.case.renamed(f"pressure:{aorta}")
        self._spaces: dict[int, Discretisation] = {}

    def run(
        self,
        changes: Mapping[str, np.ndarray],
        samples: int,
        checkpoint: Path | None = None,
        fields: Sequence[bool] | None = None,
        report=None,
        waveforms: Sequence[str] = (),
        start: np.ndarray | None = None,
    ) -> list[Outcome]:
        """Run samples: "BLOCK.parameter" → (samples,) values; one outcome each, in order. Never raises for a sample.

        Blocks of LANES samples run one after the other; a sample's numbers do not depend on its block. checkpoint:
        stem of the files that keep a block's state from cycle to cycle. fields: whose fields are wanted. waveforms:
        unknowns of the whole network, such as `pressure:A:B`, whose last cycle is wanted. start: (samples, unknowns),
        where the search for the periodic 0D states begins: a closed loop keeps the blood that it starts with.
        """
        changes = {name: np.broadcast_to(np.asarray(value, float), (samples,)) for name, value in changes.items()}
        wanted = [False] * samples if fields is None else list(fields)
        outcomes: list[Outcome | None] = [None] * samples
        pending = list(range(samples))
        for refinement in range(self.settings.refinements + 1):
            failed = []
            for first in range(0, len(pending), LANES):
                block = pending[first : first + LANES]
                part = {name: value[block] for name, value in changes.items()}
                stem = (
                    None if checkpoint is None else checkpoint.with_name(f"{checkpoint.name}_{refinement}_{block[0]}")
                )
                label = f"{block[0] + 1} to {block[-1] + 1} of {samples}"
                keep = any(wanted[k] for k in block)
                begin = None if start is None else np.asarray(start, float)[block]
                done = Block(self, part, len(block), refinement, stem, keep, report, label, waveforms, begin).run()
                for k, outcome in zip(block, done, strict=True):
                    before = outcomes[k]
                    if before is not None:
                        outcome.cpu_s += before.cpu_s
                        outcome.wall_s += before.wall_s
                        outcome.diagnostics["earlier_failures"] = [
                            *before.diagnostics.get("earlier_failures", []), before.reason,
                        ]  # fmt: skip
                    if not wanted[k]:
                        outcome.fields = {}
                    outcomes[k] = outcome
                    if not outcome.ok and outcome.diagnostics.get("retry", False):
                        failed.append(k)
            pending = failed
            if not pending:
                break
        return outcomes

    def space(self, refinement: int) -> Discretisation:
        """The mesh's operators for the time step of a refinement."""
        if refinement not in self._spaces:
            steps = self.settings.steps_per_cycle * 2**refinement
            geometry = self.geometry
            self._spaces[refinement] = Discretisation(
                geometry.points, geometry.tets, geometry.caps, geometry.inlets, self.engine.model.period / steps,
                self.density, self.viscosity,
            )  # fmt: skip
        return self._spaces[refinement]
