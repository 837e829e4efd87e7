"""Noise as the data show it: about the model alone, and again about the effects that are found with that noise."""

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.core.scatter import larger_scatter, off_line
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis
from coronaryuq.discrepancy.inference.evidence import Data
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.noise import Estimate, differing, most_probable, noise_estimates
from coronaryuq.discrepancy.inference.outliers import Outlier, find_outliers, samples_of
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.read_problem import make_problem, possible_noises, with_noise, with_time_steps
from coronaryuq.discrepancy.selection.answer import without_effects
from coronaryuq.discrepancy.selection.refit import exact


@dataclass(frozen=True)
class Observed:
    """Noise about a fit of the problem with the stated noise.

    Attributes
    ----------
    estimates
        By quantity.
    outliers
        Samples that are left out.
    right
        Whether the model of the fit is probably right; then the noise is the most probable by the evidence of the
        fitted data, else that of the scatter, on which a missing effect has less influence.
    """

    estimates: dict[str, Estimate]
    outliers: list[Outlier]
    right: bool

    @property
    def stated(self) -> "Observed":
        """The same with the stated noise as that of the search; the others remain possible."""
        return replace(self, estimates={quantity: one.chosen(0) for quantity, one in self.estimates.items()})


def observe(problem: Problem, hypothesis: Hypothesis, fit: Fit) -> Observed:
    """Return the noise of the waveforms about a fit of some effects.

    Parameters
    ----------
    problem
        The problem with the stated noise.
    hypothesis, fit
        Effects, and their fit.

    Returns
    -------
    Observed
        The noise.
    """
    estimates = noise_estimates(problem, fit.residual)
    (residual,) = problem.whitened([(fit.z, hypothesis)])
    scales = [estimates[s.quantity].scale if s.quantity in estimates else 1.0 for s in problem.forward.measured]
    outliers = find_outliers(problem, np.nan_to_num(residual) / np.array(scales)[problem.owner])
    stated = {quantity: replace(estimate, noise=None) for quantity, estimate in estimates.items()}
    possible = replace(problem, noises=possible_noises(problem, stated, []))
    used = problem.train & ~samples_of(outliers, problem.forward.measured)
    data, rows = Data(possible, used), used[problem.train]
    evidence = data.evidence(fit.at_zero[rows], fit.jacobian[rows])
    nothing, something = without_effects(evidence)
    if nothing > something:
        shown = {series.quantity for series in problem.forward.measured if series.statistic == "waveform"}
        estimates |= {quantity: estimates[quantity].chosen(evidence.noises[quantity]) for quantity in shown}
    return Observed(estimates, outliers, nothing > something)


def uneven_noise(problem: Problem) -> dict[str, float]:
    """Return quantity and condition whose noise is larger than under other conditions, and how many times.

    About the recalibrated model.

    The stated standard deviations may be wrong, but by one factor. Only scatter about the lines between neighbours
    counts, which missing effects hardly change.
    """
    (residual,), measured = problem.whitened([(problem.recalibrated.z, PLAIN)]), problem.forward.measured
    uneven: dict[str, float] = {}
    for quantity in dict.fromkeys(series.quantity for series in measured):
        off = defaultdict[str, list[np.ndarray]](list)
        for series, own in zip(measured, problem.forward.split(residual[None, :]), strict=True):
            if series.quantity == quantity and series.time is not None and np.isfinite(own).all():
                off[f"{quantity} under {series.condition}"].append(off_line(series.time, own[0])[1])
        uneven |= larger_scatter({where: np.concatenate(each) for where, each in off.items()})
    return uneven


def with_uneven_noise(problem: Problem, uneven: Mapping[str, float]) -> Problem:
    """Return the problem with standard deviations larger by factors; single values are as uncertain as waveforms."""
    times = [uneven.get(f"{series.quantity} under {series.condition}", 1.0) for series in problem.forward.measured]
    scaled = [replace(one, sd=factor * one.sd) for one, factor in zip(problem.forward.measured, times, strict=True)]
    even = make_problem(problem.forward.network, problem.forward.conditions, scaled, problem.settings)
    even.runs = problem.runs
    return with_time_steps(even)


def with_observed_noise(problem: Problem, observed: Observed, report: Callable[[str], None]) -> Problem:
    """Return the problem with the observed noise of its waveforms, and without the outliers.

    Parameters
    ----------
    problem
        The problem with the stated noise.
    observed
        The noise.
    report
        Called with a line of text if anything changes.

    Returns
    -------
    Problem
        The new problem.
    """
    noise, outliers = most_probable(observed.estimates), observed.outliers
    if noise:
        each = [f"{of} {n.scale:.2f} times, correlated over {n.correlation_time:.2g} s" for of, n in noise.items()]
        report(f"waveform noise differs from the stated standard deviations ({'; '.join(each)})")
    if outliers:
        report(f"{len(outliers)} samples are outliers, and are left out")
    known = with_noise(problem, noise, outliers) if noise or outliers else problem
    return known.with_noises(possible_noises(problem, observed.estimates, outliers))


class OtherNoise(Exception):
    """About some effects the noise is another than the one with which they were found."""

    def __init__(self, hypothesis: Hypothesis, observed: Observed):
        super().__init__("the noise about the effects found is another")
        self.hypothesis, self.observed = hypothesis, observed


def watch(problem: Problem, known: Observed, found: Problem, hypothesis: Hypothesis, fit: Fit) -> None:
    """Compare the noise of a search with that about effects that it found, which had counted as noise before.

    Parameters
    ----------
    problem
        The problem with the stated noise.
    known
        Noise of the search.
    found, hypothesis, fit
        The problem with that noise, the effects, and their fit.

    Raises
    ------
    OtherNoise
        If the noise is smaller, or the model is right with these effects and the noise is larger or of another kind.
        About a wrong effect, it may look larger, or correlated.
    """
    # The weights of shapes, which differ between the problems, start at zero.
    physical = {n.name: z for n, z in zip(found.forward.nuisances, fit.z, strict=False) if n.shape is None}
    nuisances = [physical.get(nuisance.name, 0.0) for nuisance in problem.forward.nuisances]
    refit = exact(problem, hypothesis, np.concatenate([nuisances, fit.z[found.count :]]))
    if refit is not None:
        now = observe(problem, hypothesis, refit)
        others = differing(now.estimates, known.estimates, now.right)
        if others:
            raise OtherNoise(hypothesis, replace(now, estimates=known.estimates | others))
