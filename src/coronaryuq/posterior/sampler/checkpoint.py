"""What chains continue from: their preparation, recorded states and last state, in a folder or with finished chains."""

import sys
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_npz, write_npz
from coronaryuq.posterior.model.emulator import Emulator
from coronaryuq.posterior.model.fit_to_fractions import Fit
from coronaryuq.posterior.model.flow_model import Posterior, Response
from coronaryuq.posterior.sampler.dream import State
from coronaryuq.posterior.sampler.exploration import Walk

Item = TypeVar("Item")
RECORDED = ("position", "log_density", "output", "log_weight")
"""What is recorded of each state."""
PREFIX = "checkpoint."
"""Of the arrays in a file of finished chains from which longer ones continue."""


@dataclass(frozen=True)
class Prepared:
    """What precedes the first generation: the fit, the emulator and the chains' first states.

    start (chains, d), log_density (chains,), flows (chains, N). emulator: None when not used. runs, failures: of the
    model, those of the fit included. walk: of independence steps; None without them. response: of the flows to
    uncertain parameters; None without any. k_hat: Pareto k of the pilot, nan
    without one. refused: why no independence steps are taken, if they were asked for.
    """

    fit: Fit
    emulator: Emulator | None
    start: np.ndarray
    log_density: np.ndarray
    flows: np.ndarray
    runs: int
    walk: Walk | None = None
    response: Response | None = None
    k_hat: float = np.nan
    refused: str = ""
    failures: int = 0

    def arrays(self) -> dict[str, Any]:
        return _flat("prepared", self)

    @classmethod
    def of(cls, arrays: dict[str, np.ndarray]) -> "Prepared":
        parts = {"fit": Fit, "emulator": Emulator, "walk": Walk, "response": Response}
        nested = {name: _nested(kind, f"prepared.{name}", arrays) for name, kind in parts.items()}
        prepared = _nested(cls, "prepared", arrays, nested)
        if prepared is None or prepared.fit is None:
            raise ValueError("it holds no preparation")
        return prepared


@dataclass(frozen=True)
class Checkpoint:
    """Preparation and, once chains have been saved, `done` recorded states, the last state and the failed runs.

    values: what is `RECORDED` of each state, (done, chains, ...).
    """

    prepared: Prepared
    state: State | None = None
    done: int = 0
    failures: int = 0
    values: dict[str, np.ndarray] = field(default_factory=dict)


class Recorder:
    """Recorded states of all chains, kept in one file per chain and one checkpoint, in one folder.

    `save` writes first the chain files, by the ranks that own them, then the checkpoint, by the first rank. A run that
    was killed between the two finds chain files that are longer than its checkpoint and truncates them.
    """

    def __init__(self, folder: Path, decisions: int, state: State, posterior: Posterior, key: str):
        self.folder, self.posterior, self.ranks, self.key = folder, posterior, posterior.ranks, key
        self.done = 0
        self.values = {name: np.empty((decisions, *getattr(state, name).shape), dtype=float) for name in RECORDED}

    def record(self, state: State) -> None:
        for name in RECORDED:
            self.values[name][self.done] = getattr(state, name)
        self.done += 1

    def save(self, state: State) -> None:
        chains = len(state.position)
        for chain in range(chains):
            if self.ranks.owns(chain, chains):
                values = {name: self.values[name][: self.done, chain] for name in RECORDED}
                write_npz(_chain_file(self.folder, chain), values)
        self.ranks.barrier()
        if self.ranks.rank == 0:
            write_npz(self.folder / "checkpoint.npz", self._counts() | _flat("state", state))
        self.ranks.barrier()

    def _counts(self) -> dict[str, Any]:
        return {"key": self.key, "done": self.done, "failures": self.posterior.failures}

    def resume(self, found: Checkpoint) -> State | None:
        """Take over what was recorded up to a checkpoint and return its state; None for one without states."""
        if found.state is None:
            return None
        for name in RECORDED:
            self.values[name][: found.done] = found.values[name]
        self.done, self.posterior.failures = found.done, found.failures
        return found.state

    def arrays(self, prepared: Prepared, state: State) -> dict[str, Any]:
        """Return what a file of these chains needs, besides their flows and densities, to be continued from."""
        held = self._counts() | _flat("state", state) | prepared.arrays() | {"position": self.values["position"]}
        return {PREFIX + name: value for name, value in held.items()}


def write_prepared(folder: Path, prepared: Prepared, key: str) -> None:
    """Write the preparation to the folder of a checkpoint."""
    write_npz(folder / "prepared.npz", {"key": key, **prepared.arrays()})


def find(folder: Path, before: str | Path | None, key: str) -> Checkpoint | None:
    """Return the last checkpoint of the same inputs and settings, or None.

    Parameters
    ----------
    folder
        Of the checkpoints of these chains.
    before
        File of shorter chains, from which these begin if the folder holds none.
    key
        Identifies inputs and settings, but not the length of the chains.
    """
    try:
        found = _in_folder(folder, key)
        if before and (found is None or found.state is None):
            return _in_chains(before, key)
        return found
    except (InputError, ValueError, TypeError, KeyError) as error:
        print(f"checkpoint not used: {error}", file=sys.stderr, flush=True)
        return None


def _in_folder(folder: Path, key: str) -> Checkpoint | None:
    if not (folder / "prepared.npz").is_file():
        return None
    arrays = read_npz(folder / "prepared.npz", ("key",))
    if str(arrays["key"]) != key:
        return None
    prepared = Prepared.of(arrays)
    if not (folder / "checkpoint.npz").is_file():
        return Checkpoint(prepared)
    arrays = read_npz(folder / "checkpoint.npz", ("key", "done"))
    if str(arrays["key"]) != key:
        return Checkpoint(prepared)
    done = int(arrays["done"])
    chains = [read_npz(_chain_file(folder, chain), RECORDED) for chain in range(len(prepared.start))]
    values = {name: np.stack([chain[name][:done] for chain in chains], axis=1) for name in RECORDED}
    return _checked(prepared, arrays, values)


def _in_chains(path: str | Path, key: str) -> Checkpoint:
    arrays = read_npz(path, ("log_density", "flows", "log_weight", PREFIX + "key", PREFIX + "position"))
    held = {name.removeprefix(PREFIX): value for name, value in arrays.items() if name.startswith(PREFIX)}
    if str(held["key"]) != key:
        raise ValueError(f"{path} was made from other inputs, settings or code")
    recorded = {"log_density": "log_density", "output": "flows", "log_weight": "log_weight"}
    values = {name: arrays[of].swapaxes(0, 1) for name, of in recorded.items()} | {"position": held["position"]}
    return _checked(Prepared.of(held), held, values)


def _checked(prepared: Prepared, arrays: dict[str, np.ndarray], values: dict[str, np.ndarray]) -> Checkpoint:
    done, state = int(arrays["done"]), State(**{f.name: arrays[f"state.{f.name}"] for f in fields(State)})
    if any(len(value) != done for value in values.values()):
        raise ValueError("its chains are shorter than it says")
    return Checkpoint(prepared, state, done, int(arrays["failures"]), values)


def _chain_file(folder: Path, chain: int) -> Path:
    return folder / f"chain_{chain:03d}.npz"


def _flat(name: str, item: Any) -> dict[str, Any]:
    """Return a dataclass as arrays named `name.FIELD`, those in it as `name.FIELD.FIELD`; None is left out."""
    held: dict[str, Any] = {}
    for one in fields(item):
        value = getattr(item, one.name)
        if hasattr(value, "__dataclass_fields__"):
            held |= _flat(f"{name}.{one.name}", value)
        elif value is not None:
            held[f"{name}.{one.name}"] = value
    return held


def _nested(
    kind: type[Item], name: str, arrays: dict[str, np.ndarray], nested: dict[str, Any] | None = None
) -> Item | None:
    """Return the dataclass that `_flat` wrote, None if it was None; nested: those in it."""
    inner = nested or {}
    names: Iterable[str] = [one.name for one in fields(kind) if one.name not in inner]  # type: ignore[arg-type]
    held = {one: arrays[f"{name}.{one}"] for one in names if f"{name}.{one}" in arrays}
    values = {one: value.item() if value.ndim == 0 else value for one, value in held.items()}
    return kind(**values | inner) if values else None
