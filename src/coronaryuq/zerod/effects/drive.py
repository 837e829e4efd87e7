"""Gain error of the pressure or flow that drives a network without a heart."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Parameter, Series, Values
from coronaryuq.zerod.network.waveforms import DRIVES, sampled


class DriveGain(Effect):
    """Gain error of the pressure or flow at the network's inlet, the same in every condition."""

    name = "drive_gain"
    formula = "x_in(t) = (1 + g) x_in,model(t)"
    source = "calibration; of flow by MRI: Gatehouse et al., J. Cardiovasc. Magn. Reson. 12 (2010) 5"
    signature = "all pressures and flows wrong by one factor, the same in every condition"
    native = "P or Q of the boundary condition at the inlet"
    parameters = (Parameter("gain", "1", "normal", 0.0, 0.1, "gain minus 1"),)
    is_measurement_error = True

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        inlets = dict.fromkeys(anatomy.inlet_bc[root] for root in anatomy.roots if root in anatomy.inlet_bc)
        return [inlet for inlet in inlets if anatomy.blocks[inlet]["bc_type"] in DRIVES]

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        name = f"{place}.{DRIVES[anatomy.blocks[place]['bc_type']]}"
        return {name: (1.0 + np.asarray(sizes["gain"], dtype=float))[:, None] * sampled(network, name)}
