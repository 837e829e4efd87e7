"""What drives a network without a heart, read or prescribed too high or too low."""

import numpy as np

from coronaryuq.zerod.effects.base import Effect, Parameter, sampled

DRIVES = {"PRESSURE": "P", "FLOW": "Q"}
"""Waveform of each kind of boundary condition that drives a network."""


class DriveGain(Effect):
    """Pressure or flow at the network's inlet that is a factor off, in every condition alike."""

    name = "drive_gain"
    formula = "x_in(t) = (1 + g) x_in,model(t)"
    source = "calibration; of flow by MRI: Gatehouse et al., J. Cardiovasc. Magn. Reson. 12 (2010) 5"
    signature = "pressures and flows everywhere a factor off, in every condition alike"
    native = "P or Q of the boundary condition at the inlet"
    parameters = (Parameter("gain", "1", "normal", 0.0, 0.1, "gain less 1"),)
    of_an_instrument = True

    def places(self, anatomy, observed=()):
        inlets = dict.fromkeys(anatomy.inlet_bc[root] for root in anatomy.roots if root in anatomy.inlet_bc)
        return [inlet for inlet in inlets if anatomy.blocks[inlet]["bc_type"] in DRIVES]

    def changes(self, network, place, sizes, anatomy, condition):
        name = f"{place}.{DRIVES[anatomy.blocks[place]['bc_type']]}"
        return {name: (1.0 + np.asarray(sizes["gain"], dtype=float))[:, None] * sampled(network, name)}
