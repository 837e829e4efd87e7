"""Runs of a model from which its known errors follow; noise only weighs them, so each is made once."""

from dataclasses import dataclass, field

import numpy as np

from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.inference.vessel_errors import VesselErrors, vessel_errors


@dataclass(eq=False)
class ErrorRuns:
    """Predictions of a model with refined time steps, and with errors of its vessels."""

    forward: Forward
    _vessels: VesselErrors | None = None
    _models: dict[int, Forward] = field(default_factory=dict)
    _known: dict[tuple[int, bytes], np.ndarray] = field(default_factory=dict)
    _with_vessels: dict[tuple[str, ...], "ErrorRuns"] = field(default_factory=dict)

    @property
    def vessels(self) -> VesselErrors:
        """The errors of the vessels that are no parameters of the model."""
        self._vessels = self._vessels or vessel_errors(self.forward)
        return self._vessels

    def change(self, points: np.ndarray, times: int, finer: int) -> np.ndarray:
        """Return the change (n, N) of the predictions from one refinement of the time steps to another, at (n, p)."""
        # The coarser runs come first, because in a closed loop the others start from their states.
        coarse = self.predicted(points, times)
        return self.predicted(points, finer) - coarse

    def predicted(self, points: np.ndarray, times: int) -> np.ndarray:
        """Return the predictions (n, N) at points (n, p) with refined time steps."""
        if (key := (times, points.tobytes())) not in self._known:
            if times not in self._models:
                self._models[times] = self.forward if times == 1 else self.forward.refined(times)
            self._known[key] = self._models[times].predict(points)
        return self._known[key]

    def with_vessels(self, noise: np.ndarray) -> "ErrorRuns":
        """Return the runs of the model whose parameters include the errors of the vessels with a large effect.

        noise: standard deviations of the data: (N,), CGS.
        """
        large, others = self.vessels.parted(noise)
        key = tuple(error.name for error in large)
        if key not in self._with_vessels:
            self._with_vessels[key] = ErrorRuns(self.forward.with_nuisances([*self.forward.nuisances, *large]), others)
        return self._with_vessels[key]
