"""Runs of a model from which its known errors follow; noise only weighs them, so each is made once."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.forward.predict import Forward, Waveforms
from coronaryuq.discrepancy.forward.unresolved import waveforms
from coronaryuq.discrepancy.inference.vessel_errors import VesselErrors, lumping_errors, vessel_errors


@dataclass(eq=False)
class ErrorRuns:
    """Predictions of a model with refined time steps, and with errors of its vessels."""

    forward: Forward
    _models: dict[int, Forward] = field(default_factory=dict)
    _known: dict[tuple[int, bytes], np.ndarray] = field(default_factory=dict)
    _waves: dict[tuple, Waveforms] = field(default_factory=dict)

    @cached_property
    def vessels(self) -> VesselErrors:
        """The errors of the vessels that are no parameters of the model."""
        return vessel_errors(self.forward)

    @cached_property
    def lumping(self) -> VesselErrors:
        """The errors of vessels as lumps, as far as they are linear."""
        return lumping_errors(self.forward)

    def change(self, points: np.ndarray, times: int, finer: int) -> np.ndarray:
        """Return the change (n, N) of the predictions from one refinement of the time steps to another, at (n, p)."""
        # The coarser runs come first, because in a closed loop the others start from their states.
        coarse = self.predicted(points, times)
        return self.predicted(points, finer) - coarse

    def predicted(self, points: np.ndarray, times: int) -> np.ndarray:
        """Return the predictions (n, N) at points (n, p) with refined time steps."""
        if (key := (times, points.tobytes())) not in self._known:
            self._known[key] = self._model(times).predict(points)
        return self._known[key]

    def waveforms(self, points: np.ndarray, times: int, effects: Hypothesis) -> Waveforms:
        """Return the waveforms at points (n, p) with refined time steps, at the usual steps; see `waveforms`."""
        if (key := (times, points.tobytes(), *(placed.key for placed in effects))) not in self._waves:
            found = waveforms(self._model(times), points, effects)
            self._waves[key] = {
                condition: {name: wave[:, ::times] for name, wave in waves.items()}
                for condition, waves in found.items()
            }
        return self._waves[key]

    def _model(self, times: int) -> Forward:
        if times not in self._models:
            self._models[times] = self.forward if times == 1 else self.forward.refined(times)
        return self._models[times]

    @cached_property
    def with_vessels(self) -> "ErrorRuns":
        """The runs of the model with all errors of the vessels as its last parameters."""
        return ErrorRuns(self.forward.with_nuisances([*self.forward.nuisances, *self.vessels.errors]))
