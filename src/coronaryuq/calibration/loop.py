"""The closed loop as calibration uses it: parameters in, clinical measures out, in batches, at the periodic state."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from coronaryuq.calibration import parameters
from coronaryuq.calibration.targets import in_own_units
from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology
from coronaryuq.zerod.cardiac_function import measure, waveform_names
from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.periodic import Periodicity

RIGHT_ATRIUM = "V_RA:CLH"


@dataclass(frozen=True)
class Evaluation:
    """A batch's measures (name → (n,)) in the targets' units, its status (n,) and periodic state (n, unknowns)."""

    measures: dict[str, np.ndarray]
    status: np.ndarray
    state: np.ndarray
    time: np.ndarray
    waves: dict[str, np.ndarray]

    @property
    def ok(self) -> np.ndarray:
        return self.status == "ok"


class Loop:
    """A network (CGS, closed loop) whose 36 parameters can be set, run to its periodic state with a given blood volume.

    A closed loop conserves its blood volume, so it has one periodic state for every stressed volume. The volume is that
    of the network's initial condition times the parameter V_blood; a run that starts from a neighbour's state first
    adds or removes the difference at the right atrium, so that its result does not depend on the starting state.
    """

    def __init__(self, network: Network, steps_per_cycle: int, threads: int = 1):
        self.network, self.engine = network, Engine(network)
        self.steps_per_cycle, self.threads = steps_per_cycle, threads
        self.roles = waveform_names(network)
        self.blood = BloodVolume(self.engine.model)
        self.right_atrium = self.engine.model.index[RIGHT_ATRIUM]
        first = self.initial_state()
        self.reference_volume = float(
            self.blood.evaluate(first[None], parameters.changes(parameters.INITIAL[None], network))[0]
        )
        self.evaluations = 0

    def initial_state(self) -> np.ndarray:
        """Return the state of the network's `initial_condition`, in the form of `Result.state`."""
        condition = self.network.get("initial_condition", {})
        state = np.zeros(len(self.engine.state_names))
        for index, name in enumerate(self.engine.unknowns):
            pressure = name.startswith(("pressure:", "P_c:"))
            state[index] = condition.get(name, condition.get("pressure_all", 0.0) if pressure else 0.0)
        return state

    def bed_flows(self, beds: Sequence[str]) -> list[str]:
        """Return the 0D names of the flow into each bed."""
        feeding = Topology(self.network).vessel_of
        return [f"flow:{feeding[bed]}:{bed}" for bed in beds]

    def evaluate(
        self,
        points: np.ndarray,
        start: np.ndarray | None = None,
        cycles: int | None = None,
        tolerance: float = 1e-5,
        steps_per_cycle: int | None = None,
        extra: Mapping[str, np.ndarray | float] | None = None,
        waveforms: Sequence[str] = (),
        refill: bool = True,
    ) -> Evaluation:
        """Run points (n, 36), from states (n, columns of the engine's state) where given, and measure the last cycle.

        Exactly `cycles` cycles, or, without a number, until the cycle-to-cycle error is below `tolerance`. `extra`
        changes are applied in addition to the parameters; `waveforms` are 0D names to return in addition to the roles
        of `waveform_names`. Without `refill` the loop keeps the blood of the state that it starts from, as in the runs
        of a campaign.
        """
        points = np.atleast_2d(points)
        changed = parameters.changes(points, self.network) | dict(extra or {})
        state = np.tile(self.initial_state(), (len(points), 1)) if start is None else np.array(start)
        wanted = self.reference_volume * parameters.values(points)[:, parameters.NAMES.index("V_blood")]
        if refill:
            state[:, self.right_atrium] += wanted - self.blood.evaluate(state, changed)
        names = sorted({name for members in self.roles.values() for name in members} | set(waveforms))
        run = (
            partial(self.engine.run_to_periodic, periodicity=Periodicity(tolerance))
            if cycles is None
            else partial(self.engine.run_cycles, cycles=cycles)
        )
        result = run(
            changed,
            waveforms=names,
            steps_per_cycle=steps_per_cycle or self.steps_per_cycle,
            start=state,
            threads=self.threads,
        )
        self.evaluations += len(points)
        nothing = np.zeros((len(points), len(result.time)))
        waves = {role: sum((result.waveforms[n] for n in members), nothing) for role, members in self.roles.items()}
        measures = in_own_units(measure(result.time, waves))
        waves |= {name: result.waveforms[name] for name in waveforms}
        return Evaluation(measures, np.asarray(result.status), np.asarray(result.state), result.time, waves)
