"""Mean flow into each LV-perfusing bed, from the 0D engine."""

from collections.abc import Container, Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology
from coronaryuq.core.errors import InputError
from coronaryuq.posterior.model.steady_tree import SteadyTree
from coronaryuq.zerod.network.beds import distal_resistances, resistance_changes
from coronaryuq.zerod.network.changes import with_changes
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.periodic import Periodicity
from coronaryuq.zerod.solver.result import Result
from coronaryuq.zerod.theta import Theta


def with_resistances(
    network: Network, path: str | Path, multipliers: Mapping[str, float] | None = None, hyperaemia: float = 1.0
) -> Network:
    """Return a copy of the network, read from `path`, with changed resistances: see `zerod` `resistance_changes`."""
    changes = resistance_changes(network, multipliers, hyperaemia=hyperaemia)
    return with_changes(network, {name: float(value) for name, value in changes.items()}, path)


class BedFlows:
    """Flows of the tuned hyperaemic loop at multipliers of its bed resistances and values of its uncertain parameters.

    Every run starts from the periodic state at r-hat, so its numbers depend on its own multipliers only.

    Parameters
    ----------
    network_json
        The loop, svZeroDSolver JSON.
    vessels
        Bed (boundary condition) → vessel that ends in it, of the beds that perfuse the LV, in the order of the targets.
    tolerance
        Relative cycle-to-cycle error of a periodic run (1).
    steps_per_cycle
        Time steps per cycle; as in the network if None.
    threads
        Of the 0D engine.
    network
        The loop of the file, if it has been read and changed already.
    further
        Columns of θ that are inputs of `flows` between the multipliers and the uncertain parameters.

    Raises
    ------
    InputError
        If an outlet's bed is not a coronary bed of the loop, or if the loop does not run.
    """

    def __init__(
        self, network_json: str | Path, vessels: Mapping[str, str], *, tolerance: float, steps_per_cycle: int | None,
        threads: int = 1, network: Network | None = None, further: Sequence[str] = (),
    ):  # fmt: skip
        self.network = read_network(network_json) if network is None else network
        self.engine, self.theta = Engine(self.network, network_json), Theta(self.network, network_json)
        self.beds, self.further = list(vessels), list(further)
        # An adopted branch ends the vessel ahead of a stub to the bed.
        feeding = {**vessels, **Topology(self.network).vessel_of}
        self.quantities = [f"mean_flow:{feeding[bed]}:{bed}" for bed in self.beds]
        self.tolerance, self.steps_per_cycle, self.threads = tolerance, steps_per_cycle, threads
        totals = distal_resistances(self.network)
        for bed in self.beds:
            if bed not in totals:
                raise InputError(
                    network_json, bed, None, f"not a coronary bed; there are {', '.join(totals) or 'none'}"
                )
        self.resistances = np.array([totals[bed] for bed in self.beds])
        self.weights = (1.0 / self.resistances) / np.sum(1.0 / self.resistances)
        root = Topology(self.network).roots[0]
        ahead = f"mean_pressure:{Topology(self.network).inlet(root)}"
        at_r_hat = self._run({}, None, ahead)
        if not np.all(at_r_hat.ok):
            raise InputError(
                network_json, None, None, f"the simulation fails ({at_r_hat.status[0]}); calibrate the network first"
            )
        self.start = at_r_hat.state[0]
        self.file, self.pressure = network_json, float(at_r_hat.values[ahead][0])

    def flows(self, inputs: np.ndarray) -> np.ndarray:
        """Return mean flows (n, N) in mL/s, nan where a run failed.

        inputs (n, N) or (n, N + k): multipliers, `further` ones, and values of the network's uncertain parameters, else
        at their centres.
        """
        result = self._run(self._changes(inputs), self.start)
        flows = np.stack([result.values[name] for name in self.quantities], axis=1)
        return np.where(result.ok[:, None], flows, np.nan)

    @cached_property
    def tree(self) -> SteadyTree:
        """The trees ahead of the beds, at the mean pressure at r-hat."""
        return SteadyTree(self.network, self.file, self.beds, self.pressure)

    def steady(self, inputs: np.ndarray) -> np.ndarray:
        """Return the flows (n, N) of the `SteadyTree` for the inputs of `flows`."""
        return self.tree.flows(self._changes(inputs, self.tree.places))

    def _changes(self, inputs: np.ndarray, wanted: Container[str] | None = None) -> dict[str, np.ndarray]:
        columns = [*self.beds, *self.further, *self.theta.laws.names][: inputs.shape[1]]
        return self.theta.changes(dict(zip(columns, inputs.T, strict=True)), wanted)

    def _run(self, changes: dict[str, np.ndarray], start: np.ndarray | None, *more: str) -> Result:
        return self.engine.run_to_periodic(
            changes, quantities=[*self.quantities, *more], periodicity=Periodicity(self.tolerance),
            steps_per_cycle=self.steps_per_cycle, start=start, threads=self.threads,
        )  # fmt: skip
