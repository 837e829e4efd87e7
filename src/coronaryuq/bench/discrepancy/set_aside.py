"""Effects outside the library that are set aside: the search is developed without its answers to them.

They run only with `--set-aside FILE`, once the search is finished.
"""

from collections.abc import Callable

import numpy as np

from coronaryuq.bench.discrepancy.recordings_outside import Channel, one_of
from coronaryuq.case.network.network import Network
from coronaryuq.discrepancy.hidden.experiment import Experiment
from coronaryuq.discrepancy.hidden.nature import Outside, Records
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.grafting import put_ahead
from coronaryuq.zerod.solver.engine import Engine


def line_echo(experiment: Experiment, random: np.random.Generator) -> Outside | None:
    """Return a pressure line with an echo: half of the pulse again, 80 ms later; its steady gain is one.

    Source: Oppenheim & Schafer, Discrete-Time Signal Processing, 3rd ed. (2010), ch. 13 (echoes).
    """
    channel = one_of("pressure", _channels(experiment), random)
    if channel is None:
        return None

    def law(records: Records, periods: dict[str, float]) -> Records:
        def echoed(name: str, wave: np.ndarray) -> np.ndarray:
            phase = np.arange(len(wave)) / len(wave)
            late = np.interp(phase - 0.08 / periods[name], phase, wave, period=1.0)
            return (wave + 0.5 * late) / 1.5

        return {name: waves | {channel: echoed(name, waves[channel])} for name, waves in records.items()}

    return Outside(records=law)


def baseline_droop(experiment: Experiment, random: np.random.Generator) -> Outside | None:
    """Return a flow channel with an AC-coupled amplifier of time constant 0.25 s, its mean read separately.

    Source: Horowitz & Hill, The Art of Electronics, 3rd ed. (2015), section 1.7.
    """
    channel = one_of("flow", _channels(experiment), random)
    if channel is None:
        return None

    def law(records: Records, periods: dict[str, float]) -> Records:
        def coupled(name: str, wave: np.ndarray) -> np.ndarray:
            spectrum = np.fft.rfft(wave)
            turn = 2j * np.pi * np.arange(1, len(spectrum)) * 0.25 / periods[name]
            spectrum[1:] *= turn / (1.0 + turn)
            return np.fft.irfft(spectrum, len(wave))

        return {name: waves | {channel: coupled(name, waves[channel])} for name, waves in records.items()}

    return Outside(records=law)


def slew_limit(experiment: Experiment, random: np.random.Generator) -> Outside | None:
    """Return a pressure channel whose amplifier changes by no more than 30 % of the pressure's own largest rate.

    Source: Horowitz & Hill, The Art of Electronics, 3rd ed. (2015), section 4.4 (slew rate).
    """
    channel = one_of("pressure", _channels(experiment), random)
    if channel is None:
        return None

    def law(records: Records, periods: dict[str, float]) -> Records:
        def read(name: str) -> np.ndarray:
            wave = records[name][channel]
            rates = {one: np.abs(np.diff(records[one][channel])).max() * len(wave) / periods[one] for one in records}
            return slewed(wave, 0.3 * max(rates.values()) * periods[name] / len(wave))

        return {name: waves | {channel: read(name)} for name, waves in records.items()}

    return Outside(records=law)


def contractility_with_rate(experiment: Experiment, random: np.random.Generator) -> Outside | None:
    """Return a heart that contracts by 40 % more in pacing only (staircase).

    Source: Bowditch (1871); Endoh, Eur. J. Pharmacol. 500 (2004) 73.
    """

    def stronger(network: Network, condition: str) -> Network:
        if condition == "pacing":
            if network.closed_loop:
                network.heart["parameters"]["Elv_s"] *= 1.4
            for block in network.boundary_conditions:
                if "Pim" in block["bc_values"]:
                    block["bc_values"]["Pim"] = (1.4 * np.asarray(block["bc_values"]["Pim"])).tolist()
        return network

    return Outside(network=stronger)


def dynamic_stenosis(experiment: Experiment, random: np.random.Generator) -> Outside | None:
    """Return a stenosis that narrows as its distal mean pressure falls, and opens with pressure.

    Loss coefficient K = K_0 (P_rest / P)^6, P the distal mean pressure, at most 40 K_0; K_0 loses 2 % of the mean
    pressure at the mean flow at rest. Source: Santamore & Walinsky, Am. J. Cardiol. 45 (1980) 276.
    """
    anatomy = Anatomy(experiment.network)
    # The element that loses pressure is put ahead of the vessel, which would rename a measured inlet.
    measured = {entry[1] for entry in experiment.plan.entries}
    free = [vessel for vessel in anatomy.coronary_vessels if anatomy.inlet(vessel) not in measured]
    if not free:
        return None
    vessel = free[int(random.integers(len(free)))]
    pressure, flow = f"mean_pressure:{anatomy.outlet(vessel)}", f"mean_flow:{anatomy.outlet(vessel)}"

    def means(network: Network) -> tuple[float, float]:
        run = Engine(network).run_to_periodic(quantities=[pressure, flow], steps_per_cycle=300)
        return float(run.values[pressure][0]), float(run.values[flow][0])

    rest_pressure, rest_flow = means(experiment.network)
    least = 0.02 * rest_pressure / rest_flow**2

    def narrowed(network: Network, condition: str) -> Network:
        network = put_ahead(network, vessel, "dynamic")
        values = network.vessel_values(f"{vessel}_dynamic")
        factor = 1.0
        for _ in range(8):
            values["stenosis_coefficient"] = least * factor
            present = max(means(network)[0] / rest_pressure, 0.05)
            # Half a step in the logarithm: the loss lowers the pressure that raises the loss.
            factor = min(np.sqrt(factor * present**-6.0), 40.0)
        return network

    return Outside(network=narrowed)


def _channels(experiment: Experiment) -> list[Channel]:
    return [(quantity, place) for quantity, place, statistic, _ in experiment.plan.entries if statistic == "waveform"]


def slewed(wave: np.ndarray, step: float) -> np.ndarray:
    """Return a periodic waveform as read by what changes by no more than `step` from sample to sample."""
    read, last = np.empty_like(wave), wave[0]
    # In the second beat it is periodic.
    for number, value in enumerate((*wave, *wave)):
        last += np.clip(value - last, -step, step)
        read[number % len(wave)] = last
    return read


EFFECTS: dict[str, Callable[[Experiment, np.random.Generator], Outside | None]] = {
    make.__name__: make for make in (line_echo, baseline_droop, slew_limit, contractility_with_rate, dynamic_stenosis)
}
