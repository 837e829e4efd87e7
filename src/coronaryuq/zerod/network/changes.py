"""A network with one sample's changes, by the "BLOCK.parameter" names of `Engine.run_cycles`."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.numbering import PERIOD
from coronaryuq.zerod.network.period import period_of, set_period

Changes = Mapping[str, float] | Mapping[str, np.ndarray] | Mapping[str, float | np.ndarray]


def with_changes(network: Network, changes: Changes, file: str | Path = "network") -> Network:
    """Return a copy of the network with `changes` written into it.

    Parameters
    ----------
    network : Network
        A checked network.
    changes : mapping of str to float or array
        "BLOCK.parameter" → value, or waveform at even times over the cycle. A changed period stretches the waveforms
        with it.
    file : str or Path
        Name for error messages.

    Returns
    -------
    Network
        The changed copy.

    Raises
    ------
    InputError
        If a block is not in the network.
    """
    changed = network.deep_copy()
    values = {element.name: element.values for element in changed.elements()}
    own = {
        f"{element.name}.{key}": element.values
        for element in changed.elements()
        if element.part == "chambers"
        for key in element.values
    }
    for name, value in changes.items():
        if name == PERIOD:
            set_period(changed, float(value))
            continue
        block, _, parameter = name.rpartition(".")
        parameter, _, place = parameter.partition("[")
        if block not in values:
            raise InputError(file, name, None, "no block of the network has this name")
        if place:
            values[block][parameter][int(place.rstrip("]"))] = float(value)
        elif np.ndim(value):
            _set_waveform(values[block], parameter, np.asarray(value, dtype=float), period_of(changed))
        else:
            own.get(name, values[block])[parameter] = float(value)
    return changed


def _set_waveform(values: dict, parameter: str, waveform: np.ndarray, period: float) -> None:
    """Set a waveform of a block; its times are kept if they are as many and even."""
    values[parameter], times = waveform.tolist(), values["t"]
    if len(times) != len(waveform) or not np.allclose(np.diff(times, n=2), 0.0):
        values["t"] = np.linspace(0.0, period, len(waveform)).tolist()
