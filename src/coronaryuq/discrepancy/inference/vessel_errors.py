"""Errors of the vessels' own resistance, inertance and compliance, as shapes of the predictions.

A lumen is segmented with an error, and a wall's stiffness is not measured. Both change predictions little, so their
effect is linear, and its few leading shapes get weights, like those of the time steps.
"""

from dataclasses import replace

import numpy as np

from coronaryuq.discrepancy.forward.nuisance import Nuisance, present
from coronaryuq.discrepancy.forward.predict import Forward

SD_RESISTANCE, SD_COMPLIANCE = 0.08, 0.12
"""Standard deviations of the logs: 0.08 is that of a radius by 2 %, in the resistance of Poiseuille's law."""
SHAPED = 0.3
"""Norm of a shape, in noise standard deviations, above which it gets a weight."""
ELEMENTS = (("resistance", ("R_poiseuille", "L"), SD_RESISTANCE), ("compliance", ("C",), SD_COMPLIANCE))


def vessel_errors(forward: Forward, noise: np.ndarray) -> tuple[list[Nuisance], np.ndarray, np.ndarray]:
    """Return the shapes of the vessels' errors, and what they leave.

    Parameters
    ----------
    forward
        The model.
    noise
        Standard deviations of the data: (N,), CGS.

    Returns
    -------
    weights, shapes, sd
        Nuisance parameters whose rows of `Forward.shapes` are yet to be numbered, these rows (k, N), and the standard
        deviations of the rest (N,), CGS.
    """
    errors = [
        Nuisance(f"{name} of {vessel}", sd, targets)
        for vessel in forward.anatomy.coronary_vessels
        for name, elements, sd in ELEMENTS
        if (targets := present(forward.anatomy, vessel, elements))
    ]
    own = replace(forward, simulation=forward.simulation.fresh(), nuisances=[*forward.nuisances, *errors], shapes=None)
    # First alone: in a closed loop the others start from its state.
    (plain,) = own.predict(np.zeros(len(own.nuisances)))
    moved = own.predict(np.eye(len(own.nuisances))[len(forward.nuisances) :])
    run = [(error, other - plain) for error, other in zip(errors, moved, strict=True) if np.isfinite(other).all()]
    if not run:
        return [], np.zeros((0, forward.size)), np.zeros(forward.size)
    shares, lengths, directions = np.linalg.svd(np.array([change for _, change in run]) / noise, full_matrices=False)
    scaled, kept = lengths[:, None] * directions * noise, lengths > SHAPED
    weights = [
        Nuisance(
            f"vessels, shape {number + 1}",
            1.0,
            shape=number,
            elements=tuple(
                (target, error.sd * float(share))
                for (error, _), share in zip(run, shares[:, number], strict=True)
                for target in error.targets
            ),
        )
        for number in np.flatnonzero(kept).tolist()
    ]
    return weights, scaled[kept], np.sqrt((scaled[~kept] ** 2).sum(axis=0))
