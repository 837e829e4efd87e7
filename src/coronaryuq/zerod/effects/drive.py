"""Errors of the pressure or flow that drives a network: its size, and the size of its pulsation."""

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Parameter, Series, Values
from coronaryuq.zerod.network.waveforms import DRIVES, sampled


class Drive(Effect):
    """Base class of errors of the pressure or flow at the network's inlet, the same in every condition."""

    native = "P or Q of the boundary condition at the inlet"
    is_measurement_error = True

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        inlets = dict.fromkeys(anatomy.inlet_bc[root] for root in anatomy.roots if root in anatomy.inlet_bc)
        return [inlet for inlet in inlets if anatomy.blocks[inlet]["bc_type"] in DRIVES]

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        name = f"{place}.{DRIVES[anatomy.blocks[place]['bc_type']]}"
        return {
            name: self.driven({key: np.asarray(size)[:, None] for key, size in sizes.items()}, sampled(network, name))
        }

    @abstractmethod
    def driven(self, sizes: Values, wave: np.ndarray) -> np.ndarray:
        """Return the true drives (n, points) over a cycle, both ends included, for sizes (n, 1) and the model's."""


class DriveGain(Drive):
    """Gain error of the drive."""

    name = "drive_gain"
    formula = "x_in(t) = (1 + g) x_in,model(t)"
    source = "calibration; of flow by MRI: Gatehouse et al., J. Cardiovasc. Magn. Reson. 12 (2010) 5"
    signature = "all pressures and flows wrong by one factor, the same in every condition"
    parameters = (Parameter("gain", "1", "normal", 0.0, 0.1, "gain minus 1"),)

    def driven(self, sizes: Values, wave: np.ndarray) -> np.ndarray:
        return (1.0 + sizes["gain"]) * wave


class DrivePulsatility(Drive):
    """Pulsation of the drive that is too small or too large in the model, about a right mean.

    Images average over their temporal resolution and over beats; catheters damp a pulse, or overshoot.
    """

    name = "drive_pulsatility"
    formula = "x_in(t) = mean + (1 + p) (x_in,model(t) - mean)"
    source = "Gardner, Anesthesiology 54 (1981) 227 (systolic pressure too high or low); the spread is our judgement"
    signature = "the pulsation of all pressures and flows wrong by one factor, with right means, in every condition"
    parameters = (Parameter("pulsation", "1", "normal", 0.0, 0.15, "pulsation over that of the model, minus 1"),)

    def driven(self, sizes: Values, wave: np.ndarray) -> np.ndarray:
        return wave + sizes["pulsation"] * (wave - wave[:-1].mean())
