"""Running the chains: preparation, checkpoints, one file per chain, progress."""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_npz, write_npz
from coronaryuq.core.ranks import Ranks
from coronaryuq.core.seeds import generator
from coronaryuq.posterior.model.emulator import Emulator, design, design_size
from coronaryuq.posterior.model.fit_to_fractions import Fit
from coronaryuq.posterior.model.flow_model import Posterior
from coronaryuq.posterior.model.total_resistance import Conditioned, Rescaled
from coronaryuq.posterior.sampler.diagnostics import split_rhat
from coronaryuq.posterior.sampler.dream import Dream, State
from coronaryuq.posterior.sampler.independence import Independence, Walk, try_emulator
from coronaryuq.posterior.settings import Settings


@dataclass
class Prepared:
    """What precedes the first generation: the emulator and the chains' first states.

    start (chains, d), log_density (chains,), flows (chains, N). emulator: None when not used. runs: of the model, those
    of the fit included. walk: of independence steps; None without them. k_hat: Pareto k of the pilot, nan without one.
    refused: why no independence steps are taken, if they were asked for.
    """

    emulator: Emulator | None
    start: np.ndarray
    log_density: np.ndarray
    flows: np.ndarray
    runs: int
    walk: Walk | None = None
    k_hat: float = np.nan
    refused: str = ""


def prepare(posterior: Posterior, fit: Fit, settings: Settings, seed: int) -> Prepared:
    """Run the model for the emulator and for the chains' first states; all ranks together.

    With an emulator, which needs coordinates on the constraint, the chains start at its design points, which are wider
    spread than the posterior, or, for independence steps, at weighted draws of the emulator; without one, at draws of
    the prior.
    """
    space, likelihood, chains = posterior.space, posterior.likelihood, settings.dream.chains
    random = generator(seed, "posterior", "start")
    if not settings.emulator.use or isinstance(space, Rescaled):
        start, log_density, flows = _alive(posterior, lambda count: space.draw(random, count), chains)
        return Prepared(None, start, log_density, flows, fit.runs + chains)
    count = max(settings.emulator.design or design_size(space.dimension), chains)
    y, log_density, flows = _alive(
        posterior, lambda n: design(space, likelihood, fit.multipliers, fit.flows, n, random), count
    )
    emulator = posterior.ranks.run_on_first(lambda: Emulator.fit(y, space.multipliers(y), flows))
    prepared = Prepared(emulator, y[:chains], log_density[:chains], flows[:chains], fit.runs + count)
    if not settings.independence.use:
        return prepared
    pilot = try_emulator(posterior, emulator.screen(space, likelihood), prepared.start, settings, seed)
    prepared = replace(prepared, runs=prepared.runs + pilot.runs, k_hat=pilot.k_hat, refused=pilot.refused)
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


def sampler(posterior: Posterior, prepared: Prepared, settings: Settings, seed: int) -> Dream:
    """Independence steps on this posterior, or DREAM, screened by the emulator if there is one."""
    space, screen = posterior.space, None
    if prepared.emulator is not None and isinstance(space, Conditioned):
        screen = prepared.emulator.screen(space, posterior.likelihood)
        if prepared.walk is not None:
            return Independence(posterior, screen, prepared.walk, settings, seed)
    return Dream(
        posterior, settings.dream, seed, screen=screen, every=settings.emulator.generations,
        box=space.box, adjust=space.adjust,
    )  # fmt: skip


Multipliers = Callable[[np.ndarray], np.ndarray]
"""Of r-hat (n, N), at coordinates (n, d)."""


class Recorder:
    """Recorded states of all chains, kept in one file per chain and one checkpoint, in one folder.

    `save` writes first the chain files, by the ranks that own them, then the checkpoint, by the first rank. A run that
    was killed between the two finds chain files that are longer than its checkpoint and truncates them.
    """

    NAMES = ("position", "log_density", "output", "log_weight")

    def __init__(self, folder: Path, decisions: int, state: State, ranks: Ranks, key: str):
        self.folder, self.ranks, self.key = folder, ranks, key
        self.done = 0
        self.values = {
            name: np.empty((decisions, *getattr(state, name).shape), dtype=float) for name in self.NAMES
        }  # fmt: skip

    def record(self, state: State) -> None:
        for name in self.NAMES:
            self.values[name][self.done] = getattr(state, name)
        self.done += 1

    def save(self, state: State) -> None:
        chains = len(state.position)
        for chain in range(chains):
            if self.ranks.owns(chain, chains):
                values = {name: self.values[name][: self.done, chain] for name in self.NAMES}
                write_npz(self.folder / f"chain_{chain:03d}.npz", values)
        self.ranks.barrier()
        if self.ranks.rank == 0:
            write_npz(self.folder / "checkpoint.npz", {"key": self.key, "done": self.done, **state.arrays()})
        self.ranks.barrier()

    def resume(self) -> State | None:
        """Return the state of the last checkpoint of the same inputs and settings, or None."""
        path = self.folder / "checkpoint.npz"
        if not path.is_file():
            return None
        try:
            arrays = read_npz(path, ("key", "done"))
            if str(arrays["key"]) != self.key:
                return None
            state = State(**{name: value for name, value in arrays.items() if name not in ("key", "done")})
            done = int(arrays["done"])
            for chain in range(len(state.position)):
                kept = read_npz(self.folder / f"chain_{chain:03d}.npz", self.NAMES)
                for name in self.NAMES:
                    self.values[name][:done, chain] = kept[name][:done]
        except (InputError, ValueError, TypeError) as error:
            print(f"checkpoint not used: {error}", file=sys.stderr, flush=True)
            return None
        self.done = done
        return state


def run(
    dream: Dream, state: State, recorder: Recorder, checkpoint: int, names: list[str], multipliers: Multipliers
) -> State:
    """Run all generations from `state`, or from the checkpoint in the recorder's folder; return the last state.

    checkpoint: decisions between two of them.
    """
    resumed = recorder.resume()
    state = state if resumed is None else resumed
    started, first = time.monotonic(), recorder.done
    while recorder.done < dream.decisions:
        dream.advance(state)
        recorder.record(state)
        if recorder.done % checkpoint == 0 or recorder.done == dream.decisions:
            recorder.save(state)
            if recorder.ranks.rank == 0:
                left = (time.monotonic() - started) / (recorder.done - first) * (dream.decisions - recorder.done)
                _progress(dream, state, recorder, names, multipliers, left)
    return state


def _progress(
    dream: Dream, state: State, recorder: Recorder, names: list[str], multipliers: Multipliers, left: float
) -> None:
    half = recorder.values["position"][recorder.done // 2 : recorder.done]
    worst = ""
    if len(half) >= 4:
        draws = multipliers(half.reshape(-1, half.shape[2])).reshape(*half.shape[:2], -1)
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
