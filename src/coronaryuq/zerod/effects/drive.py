"""What drives a network without a heart, read or prescribed too high or too low."""

import numpy as np

from coronaryuq.zerod.effects.base import WAVE_POINTS, Effect, Parameter, bed_values

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
        name = DRIVES[anatomy.blocks[place]["bc_type"]]
        values = bed_values(network, place)
        time, wave = np.asarray(values["t"], dtype=float), np.asarray(values[name], dtype=float)
        if len(wave) == 1:
            wave = np.full(WAVE_POINTS, wave[0])
        else:
            wave = np.interp(np.linspace(0.0, time[-1] - time[0], WAVE_POINTS), time - time[0], wave)
        return {f"{place}.{name}": (1.0 + np.asarray(sizes["gain"], dtype=float))[:, None] * wave}
