"""Noise as the data show it: about the model alone, and again about the effects that are found with that noise."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.noise import Estimate, Noise, noise_estimates, noise_text, smaller
from coronaryuq.discrepancy.inference.outliers import Outlier, find_outliers
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.read_problem import with_noise
from coronaryuq.discrepancy.selection.refit import exact


def with_observed_noise(
    problem: Problem, hypothesis: Hypothesis, fit: Fit, noise: dict[str, Noise], report: Callable[[str], None]
) -> tuple[Problem, list[Outlier]]:
    """Return the problem with a noise of its waveforms, and without the outliers about a fit.

    Parameters
    ----------
    problem
        The problem with the stated noise.
    hypothesis, fit
        Effects, and their fit.
    noise
        Quantity → noise of its waveforms; others have the stated one.
    report
        Called with a line of text if anything changes.

    Returns
    -------
    problem, outliers
        The new problem, and the samples left out.
    """
    if noise:
        report(f"waveform noise differs from the stated standard deviations ({noise_text(noise)})")
    (residual,) = problem.whitened([(fit.z, hypothesis)])
    scale = np.array([noise[s.quantity].scale if s.quantity in noise else 1.0 for s in problem.forward.measured])
    outliers = find_outliers(problem, np.nan_to_num(residual) / scale[problem.owner])
    if outliers:
        report(f"{len(outliers)} samples are outliers, and are left out")
    return (with_noise(problem, noise, outliers) if noise or outliers else problem), outliers


class SmallerNoise(Exception):
    """About some effects the noise is smaller than the one with which they were found; fit: under the stated noise."""

    def __init__(self, hypothesis: Hypothesis, fit: Fit):
        super().__init__("the noise about the effects found is smaller")
        self.hypothesis, self.fit = hypothesis, fit


@dataclass(frozen=True)
class NoiseWatch:
    """Noise of a search, compared with that about the effects that it finds.

    problem: with the stated noise; estimates: quantity → noise of the search.
    """

    problem: Problem
    estimates: dict[str, Estimate]

    def __call__(self, found: Problem, hypothesis: Hypothesis, fit: Fit) -> None:
        """Raise `SmallerNoise` if that about the effects of a fit to the problem `found` is smaller.

        What an effect explains had counted as noise. About a wrong effect, noise may look larger.
        """
        # The weights of shapes, which differ between the problems, start at zero.
        physical = {n.name: z for n, z in zip(found.forward.nuisances, fit.z, strict=False) if n.shape is None}
        nuisances = [physical.get(nuisance.name, 0.0) for nuisance in self.problem.forward.nuisances]
        start = np.concatenate([nuisances, fit.z[found.count :]])
        refit = exact(self.problem, hypothesis, start)
        if refit is not None and smaller(noise_estimates(self.problem, refit.residual), self.estimates):
            raise SmallerNoise(hypothesis, refit)
