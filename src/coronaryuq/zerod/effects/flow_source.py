"""Unknown source of flow at the end of a vessel, of any waveform: where and when in the beat something is missing."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.harmonics import fourier_basis
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Parameter, Series, Values
from coronaryuq.zerod.effects.grafting import add_vessel, attach, grafted_name, locations_renamed, open_end
from coronaryuq.zerod.network.waveforms import WAVE_POINTS

HARMONICS = 6
"""Harmonics of the beat, of which the waveform has a sine and a cosine each besides its mean."""
TAG = "source"


def basis(phase: np.ndarray) -> np.ndarray:
    """Return the shapes (1 + 2 `HARMONICS`, n) of a waveform at phases (n,) of the beat: mean, cosines, sines."""
    return np.ascontiguousarray(fourier_basis(phase, HARMONICS).T)


def spread() -> np.ndarray:
    """Return the prior standard deviations of the shapes' weights, which fall as those of a smooth waveform."""
    orders = np.arange(1, HARMONICS + 1)
    return np.concatenate([[1.0], *(2 * [1.0 / (1.0 + orders**2)])])


class FlowSource(Effect):
    """Flow that leaves the network at the end of a vessel, as a mean and harmonics of the beat.

    Linear in its sizes, which are fractions of the vessel's mean flow in the model. It is not in the library: it says
    where something is missing and when in the beat, not what it is. In a closed loop the blood would be lost.

    Formula: Q_source(t) = Q_model (w_0 + sum_h a_h cos(2 pi h t / T) + b_h sin(2 pi h t / T))
    """

    name = "unknown_source"
    grafted = True
    nameable = False
    parameters = tuple(
        Parameter(f"weight_{k}", "1", "normal", 0.0, float(sd), f"weight of shape {k} of the waveform, of unit scale")
        for k, sd in enumerate(spread())
    )

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return [] if anatomy.closed_loop else anatomy.coronary_vessels

    def insert(self, network: Network, place: str, anatomy: Anatomy) -> Network:
        network, junction, _ = open_end(network, place, TAG)
        stem, period = f"{TAG}~{place}", float(anatomy.period)
        bed = f"BC_{grafted_name(network, stem)}"
        silent = {"t": [0.0, period], "Q": [0.0, 0.0]}
        attach(network, junction, "outlet", add_vessel(network, stem, {"R_poiseuille": 0.0}, outlet=bed))
        network["boundary_conditions"].append({"bc_name": bed, "bc_type": "FLOW", "bc_values": silent})
        return network

    def aliases(self, place: str, anatomy: Anatomy) -> dict[str, str]:
        return locations_renamed(anatomy, place, TAG)

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        weights = np.stack([np.asarray(sizes[one.name], dtype=float) for one in self.parameters], axis=-1)
        waves = weights @ basis(np.linspace(0.0, 1.0, WAVE_POINTS))
        bed = f"BC_{grafted_name(network, f'{TAG}~{place}')}"
        return {f"{bed}.Q": anatomy.flow_scale(place) * waves}
