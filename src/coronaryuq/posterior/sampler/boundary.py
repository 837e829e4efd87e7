"""Proposals that leave a box: returned such that the proposal stays symmetric, or rejected."""

import numpy as np

from coronaryuq.posterior.sampler.proposals import Proposal


def into_box(proposal: Proposal, box: np.ndarray, how: str) -> Proposal:
    """Treat rows outside `box` (2, d).

    "reflect" mirrors at the walls as often as needed, "fold" re-enters at the opposite wall; both commute with the
    reversal of a step that does not depend on the state, so the Metropolis ratio needs no factor. A snooker step does
    depend on it: such rows, and all with "reject", get ratio zero and are clipped to stay inside.
    """
    low, high = box
    position = proposal.position
    width = high - low
    beyond = np.any((position < low) | (position > high), axis=1)
    rejected = beyond & ((proposal.crossover < 0) | (how == "reject"))
    if how == "fold":
        inside = low + np.mod(position - low, width)
    else:
        phase = np.mod(position - low, 2.0 * width)
        inside = low + np.where(phase > width, 2.0 * width - phase, phase)
    position = np.where((beyond & ~rejected)[:, None], inside, position)
    position = np.where(rejected[:, None], np.clip(position, low, high), position)
    return Proposal(position, np.where(rejected, -np.inf, proposal.log_ratio), proposal.crossover)
