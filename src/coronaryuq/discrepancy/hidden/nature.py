"""What makes the data of hidden cases, and how far it is off from the searched model."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.forward.simulation import Simulation
from coronaryuq.discrepancy.hidden.other_solver import SvZeroDSimulation
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import COMPLIANCES, RESISTANCES, Anatomy
from coronaryuq.zerod.network.differences import LOSS

TRUTH_STEPS, LOOP_STEPS = 1500, 600
"""Time steps per cycle of the truth, the latter for a closed loop by svZeroDSolver; the analysis uses 300."""
TRUTH_RHO = 0.8
"""Spectral radius of the time integration of the truth; the analysis uses 0.5."""
MASS_SPREAD = 0.2
"""Standard deviation of the true log tissue masses."""
VESSEL_VALUES = ("R_poiseuille", "L", "C")

Change = Callable[[Network, str], Network]
"""Change of the network of a condition, given by name."""
Records = dict[str, dict[tuple[str, str], np.ndarray]]
"""Condition → (quantity, location) → waveform (k,) on an even grid over the cycle, the end left out; CGS."""
Law = Callable[[Records, dict[str, float]], Records]
"""Change of the recorded waveforms; the second argument is the period of each condition, s."""


@dataclass(frozen=True)
class Outside:
    """An effect that the library does not express: a change of the networks, of the recorded waveforms, or both."""

    network: Change | None = None
    records: Law | None = None


@dataclass(frozen=True)
class Nature:
    """The program that makes the data, and the relative standard deviations of the truth about the searched model.

    Attributes
    ----------
    program
        "svzerod", svZeroDSolver; or "own", our engine with other numerics than the analysis uses.
    vessels
        Of each R, L and C of every vessel, independently; the search does not know of it.
    beds
        Of the resistance and of the compliance of each bed. All other nuisance parameters except `states` and tissue
        masses are drawn with as many of the search's prior standard deviations as this is of that of a bed.
    states
        Of the coronary resistance of every condition but the first.
    parts
        Of each of several parts of a bed's resistance and compliance, such as Rp and Rd, whose sums stay.
    """

    program: Literal["svzerod", "own"] = "own"
    vessels: float = 0.0
    beds: float = 0.09
    states: float = 0.06
    parts: float = 0.0

    def stated(self) -> dict[str, float | str]:
        """Return the program and all relative standard deviations, for the results."""
        prior = Settings()
        times = self.beds / prior.sd_bed
        return {
            "program": self.program,
            "vessels": self.vessels,
            "each bed": self.beds,
            "parts of each bed": self.parts,
            "resistance of all beds": times * prior.sd_coronary,
            "compliance of all beds": times * prior.sd_compliance,
            "systemic": times * prior.sd_systemic,
            "heart": times * prior.sd_heart,
            "blood volume": times * prior.sd_blood,
            "states": self.states,
            "tissue masses": MASS_SPREAD,
        }

    def nuisance(self, parameter: Nuisance, anatomy: Anatomy, seed: int) -> float:
        """Draw the true value z of one nuisance parameter; it does not depend on which others there are.

        Zero for a factor on vessels, whose truth is `body`.
        """
        targets = [name.rpartition(".") for name in parameter.targets]
        of_vessels = bool(targets) and all(block in anatomy.vessels and name != LOSS for block, _, name in targets)
        if parameter.shape is not None or of_vessels:
            return 0.0
        if parameter.mass is not None:
            sd = MASS_SPREAD
        elif parameter.conditions is not None and not any(name == LOSS for *_, name in targets):
            sd = self.states
        else:
            sd = self.beds / Settings().sd_bed * parameter.sd
        random = generator(seed, "discrepancy", "nature", parameter.name)
        return sd / parameter.sd * float(random.standard_normal())

    def body(self, network: Network, seed: int) -> Network:
        """Return the network with the true R, L and C of its vessels, and the true parts of its beds."""
        network, anatomy = network.deep_copy(), Anatomy(network)
        for bed in dict.fromkeys(anatomy.outlet_bc.values()) if self.parts else ():
            random, values = generator(seed, "discrepancy", "nature", "bed", bed), network.bed_values(bed)
            for names in (RESISTANCES, COMPLIANCES):
                known = np.array([values.get(name, 0.0) for name in names])
                drawn = known * np.exp(self.parts * random.standard_normal(len(names)))
                drawn *= known.sum() / max(drawn.sum(), 1e-300)
                values |= {name: new for name, new in zip(names, drawn.tolist(), strict=True) if new}
        for vessel in network.vessels:
            random = generator(seed, "discrepancy", "nature", "vessel", vessel["vessel_name"])
            values = vessel["zero_d_element_values"]
            for name, z in zip(VESSEL_VALUES, random.standard_normal(len(VESSEL_VALUES)), strict=True):
                if name in values:
                    values[name] *= float(np.exp(self.vessels * z))
        return network

    def simulation(
        self, network: Network, conditions: dict[str, Condition], anatomy: Anatomy, times: int = 1
    ) -> Simulation:
        """Return the simulation of the truth, with `times` the usual time steps."""
        network = network.deep_copy()
        network["simulation_parameters"]["rho_infty"] = TRUTH_RHO
        theirs = self.program == "svzerod"
        steps = times * (LOOP_STEPS if theirs and anatomy.closed_loop else TRUTH_STEPS)
        simulation = Simulation(network, conditions, anatomy, steps)
        return SvZeroDSimulation.like(simulation) if theirs else simulation


OUR_ENGINE = Nature()
"""Data by our engine; the beds are off by 0.6 of the search's priors, and the vessels are those of the model."""
