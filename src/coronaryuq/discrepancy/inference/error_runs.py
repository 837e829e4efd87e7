"""Runs of a model from which its known errors follow; noise only weighs them, so each is made once."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.inference.vessel_errors import VesselErrors, vessel_errors


@dataclass(eq=False)
class ErrorRuns:
    """Predictions of a model, and of the same with errors of its vessels, with refined time steps."""

    forward: Forward
    _models: dict[tuple[bool, int], Forward] = field(default_factory=dict)
    _known: dict[tuple[bool, int, bytes], np.ndarray] = field(default_factory=dict)

    @cached_property
    def vessels(self) -> VesselErrors:
        """The errors of the vessels."""
        return vessel_errors(self.forward)

    def change(self, points: np.ndarray, times: int, finer: int) -> np.ndarray:
        """Return the change (n, N) of the model's predictions from one refinement of its time steps to another."""
        # The coarser runs come first, because in a closed loop the others start from their states.
        coarse = self.predicted(points, times)
        return self.predicted(points, finer) - coarse

    def predicted(self, points: np.ndarray, times: int, vessels: bool = False) -> np.ndarray:
        """Return predictions (n, N) at points (n, p), whose last columns are errors of the vessels if these vary."""
        if (key := (vessels, times, points.tobytes())) not in self._known:
            if key[:2] not in self._models:
                model = self.vessels.model if vessels else self.forward
                self._models[key[:2]] = model if times == 1 else model.refined(times)
            self._known[key] = self._models[key[:2]].predict(points)
        return self._known[key]
