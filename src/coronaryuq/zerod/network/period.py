"""The cardiac period of a network."""

from coronaryuq.case.network.network import Network


def period_of(network: Network) -> float:
    """Return the cardiac period (s): that of the heart, or of the waveform with the most points, or the stated one.

    A network without any of these is steady; its period is 1 s.
    """
    if network.closed_loop:
        return float(network.heart["cardiac_cycle_period"])
    pulsing = [times for element in network.elements() if len(times := element.values.get("t", ())) > 1]
    if pulsing:
        times = max(pulsing, key=len)
        return float(times[-1] - times[0])
    stated = float(network["simulation_parameters"].get("cardiac_period", -1.0))
    return stated if stated > 0.0 else 1.0


def set_period(network: Network, period: float) -> None:
    """Change the cardiac period (s) of a network and stretch its waveforms to it."""
    if network.closed_loop:
        network.heart["cardiac_cycle_period"] = period
    for element in network.elements():
        values, times = element.values, element.values.get("t", ())
        if len(times) > 1:
            stretch = period / (times[-1] - times[0])
            values["t"] = [times[0] * stretch, *(time * stretch for time in times[1:-1]), times[0] * stretch + period]
    if network["simulation_parameters"].get("cardiac_period", -1.0) >= 0 or not network.closed_loop:
        network["simulation_parameters"]["cardiac_period"] = period
