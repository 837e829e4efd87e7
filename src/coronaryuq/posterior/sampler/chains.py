"""Running the chains: preparation, the sampler, generations with checkpoints, progress."""

import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.posterior.model.emulator import Emulator
from coronaryuq.posterior.model.fit_to_fractions import Fit
from coronaryuq.posterior.model.flow_model import Posterior
from coronaryuq.posterior.model.linearised import Linearised, design_size
from coronaryuq.posterior.model.most_probable import most_probable
from coronaryuq.posterior.model.tissue import PerGram
from coronaryuq.posterior.model.total_resistance import Rescaled
from coronaryuq.posterior.sampler.checkpoint import Prepared, Recorder
from coronaryuq.posterior.sampler.diagnostics import split_rhat
from coronaryuq.posterior.sampler.dream import Dream, State
from coronaryuq.posterior.sampler.independence import Independence, try_emulator
from coronaryuq.posterior.settings import Settings


def prepare(posterior: Posterior, fit: Fit, settings: Settings, seed: int) -> Prepared:
    """Run the model for the emulator and for the chains' first states; see `_prepare`."""
    prepared = _prepare(posterior, fit, settings, seed)
    return replace(prepared, response=posterior.response, failures=posterior.failures)


def _prepare(posterior: Posterior, fit: Fit, settings: Settings, seed: int) -> Prepared:
    """Run the model for the emulator and for the chains' first states; all ranks together.

    With an emulator, which states that are rescaled cannot have, the chains start at its design points, which are wider
    spread than the posterior, or, for independence steps, at weighted draws of the emulator; without one, at draws of
    the prior.
    """
    space, likelihood, chains = posterior.space, posterior.likelihood, settings.dream.chains
    random = generator(seed, "posterior", "start")
    if not settings.emulator.use or isinstance(space, Rescaled):
        start, log_density, flows = _alive(posterior, lambda count: space.draw(random, count), chains)
        return Prepared(fit, None, start, log_density, flows, fit.runs + chains)
    size = design_size(space.dimension, quadratic=posterior.inverse_steady is None)
    count = max(settings.emulator.design or size, chains)
    if isinstance(space, PerGram):
        found = most_probable(posterior, space.coordinates(fit.multipliers[None])[0])
        linearised = Linearised.at(space, likelihood, found.x, found.flows, found.slope)
        fit = replace(fit, runs=fit.runs + found.runs)
    else:
        linearised = Linearised.about(space, likelihood, fit.multipliers, fit.flows, posterior.slope)
    y, log_density, flows = _alive(posterior, lambda n: linearised.design(space, n, random), count)
    prepared = Prepared(fit, None, y[:chains], log_density[:chains], flows[:chains], fit.runs + count)
    if not settings.independence.use:
        emulator = posterior.ranks.run_on_first(lambda: Emulator.of_runs(posterior, linearised, y, flows))
        return replace(prepared, emulator=emulator)
    pilot = try_emulator(posterior, linearised, y, flows, settings, seed)
    prepared = replace(
        prepared, emulator=pilot.emulator, runs=prepared.runs + pilot.runs, k_hat=pilot.k_hat, refused=pilot.refused
    )
    if pilot.start is None:
        if posterior.ranks.rank == 0:
            print(f"warning: DREAM without independence steps: {pilot.refused}", file=sys.stderr, flush=True)
        return prepared
    start, log_density, flows = pilot.start
    return replace(prepared, walk=pilot.walk, start=start, log_density=log_density, flows=flows)


def _alive(
    posterior: Posterior, draw: Callable[[int], np.ndarray], count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`count` points where the model runs, log densities and flows there; failed points are redrawn, a few times."""
    points = draw(count)
    log_density, flows = posterior(points)
    for _ in range(10):
        dead = ~np.isfinite(log_density)
        if not np.any(dead):
            return points, log_density, flows
        points[dead] = draw(int(dead.sum()))
        log_density[dead], flows[dead] = posterior(points[dead])
    raise RuntimeError(f"the model fails at {int(dead.sum())} of {count} points of the prior, ten times in a row")


def sampler(posterior: Posterior, prepared: Prepared, settings: Settings, seed: int, length: int = 1) -> Dream:
    """Independence steps on this posterior, or DREAM, screened by the emulator if there is one.

    length: as in `Dream`.
    """
    space, screen = posterior.space, None
    if prepared.emulator is not None and not isinstance(space, Rescaled):
        screen = prepared.emulator.screen(space, posterior.likelihood, posterior.inverse_steady)
        if prepared.walk is not None:
            return Independence(posterior, screen, prepared.walk, settings, seed, length)
    return Dream(
        posterior, settings.dream, seed, screen=screen, every=settings.emulator.generations,
        box=space.box, adjust=space.adjust, length=length,
    )  # fmt: skip


Inputs = Callable[[np.ndarray], np.ndarray]
"""Multipliers of r-hat, the further inputs of the space and values of uncertain parameters, at coordinates (n, d)."""


def run(dream: Dream, state: State, recorder: Recorder, checkpoint: int, names: list[str], inputs: Inputs) -> State:
    """Run the generations that the recorder lacks, from `state`; return the last state.

    checkpoint: decisions between two of them.
    """
    started, first = time.monotonic(), recorder.done
    while recorder.done < dream.decisions:
        dream.advance(state)
        recorder.record(state)
        if recorder.done % checkpoint == 0 or recorder.done == dream.decisions:
            recorder.save(state)
            if recorder.ranks.rank == 0:
                left = (time.monotonic() - started) / (recorder.done - first) * (dream.decisions - recorder.done)
                _progress(dream, state, recorder, names, inputs, left)
    return state


def _progress(dream: Dream, state: State, recorder: Recorder, names: list[str], inputs: Inputs, left: float) -> None:
    half = recorder.values["position"][recorder.done // 2 : recorder.done]
    worst = ""
    if len(half) >= 4:
        draws = inputs(half.reshape(-1, half.shape[2])).reshape(*half.shape[:2], -1)
        rhat = split_rhat(draws.transpose(1, 0, 2))
        place = int(np.argmax(np.nan_to_num(rhat)))
        worst = f"  R-hat {rhat[place]:.3f} ({names[place]})"
    total = dream.decisions * dream.every
    acceptance = float(np.mean(state.accepted)) / max(int(state.proposed), 1)
    print(
        f"generation {int(state.generation)}/{total}{worst}  acceptance {acceptance:.2f}"
        f"  outliers {int(state.outliers)}  ETA {left / 60:.1f} min",
        file=sys.stderr, flush=True,
    )  # fmt: skip
