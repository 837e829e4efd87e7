"""What readings are relative to, from the unmodified model: offsets to a usual reading, ratios to the root pressure."""

from dataclasses import replace

import numpy as np

from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.zerod.effects.base import Channel
from coronaryuq.zerod.effects.pullback import OF_WIRE


def with_scales(forward: Forward) -> list[Measured]:
    """Return the series with the scale of their sensor's readings, where it is not known.

    Of a pressure, that is the mean at the root: the zero of a transducer is wrong by as much in an atrium as in the
    aorta. Of a flow, it is the mean of its absolute value over all conditions; of a ratio, one.
    """
    measured = _with_root_pressure(forward)
    if all(series.scale is not None for series in measured):
        return measured
    predicted = forward.split(np.abs(forward.predict(np.zeros(len(forward.nuisances)))))
    scales = {"pressure": forward.anatomy.pressure * forward.pressure_factor, "ratio": 1.0}
    flows: dict[Channel, list[float]] = {}
    for series, values in zip(forward.measured, predicted, strict=True):
        flows.setdefault(series.channel, []).append(float(values.mean()))
    return [replace(one, scale=scales.get(one.quantity, float(np.nanmean(flows[one.channel])))) for one in measured]


def _with_root_pressure(forward: Forward) -> list[Measured]:
    """Return the series; the ratios of a wire, whose drift is one of pressure, with the pressure in the denominator."""
    ratios = {s.condition: s for s in forward.measured if s.quantity == f"{OF_WIRE}ratio"}
    if not ratios:
        return forward.measured
    asked = [
        replace(s, quantity="pressure", location=root, statistic="mean", value=s.value[:1], pullback=None)
        for s in ratios.values()
        for root in [forward.root(s.pullback.path[0] if s.pullback else None)]
    ]
    alone = replace(forward, measured=asked, shapes=None)
    known = dict(zip(ratios, alone.predict(np.zeros(len(forward.nuisances)))[0].tolist(), strict=True))
    return [
        replace(s, pullback=replace(s.pullback, root_pressure=known[s.condition]))
        if s.pullback is not None and s.quantity == f"{OF_WIRE}ratio"
        else s
        for s in forward.measured
    ]
