"""`targets.json`: the mean flow and noise covariance of every LV-perfusing outlet, for calibration and posterior."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.typed import checked
from coronaryuq.perfusion.settings import NoiseModel

REMEDY = "rerun the rule `perfusion_gather`"
BORDERS = {"territories": "mean", "registration": "baseline"}
"""Errors of where territories end, and the flows of which they are errors."""

Array = Annotated[np.ndarray, BeforeValidator(lambda values: np.asarray(values, dtype=float))]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, arbitrary_types_allowed=True)


class NoiseStatistics(_Part):
    """Statistics over realisations of one noise model; flows in mL/s, volumes in cm3, N outlets.

    `bias` (N,) is mean / baseline - 1, `relative_sd` (N,) is relative to the baseline, `correlation_min` and
    `correlation_max` are those of pairs of outlets, and `total_sd` is that of the whole LV's flow, relative.
    """

    noise: NoiseModel
    mean: Array
    bias: Array
    covariance: Array
    relative_sd: Array
    correlation: Array
    correlation_min: float
    correlation_max: float
    total_sd: float
    volume_mean: Array
    volume_sd: Array


class VentricleTotals(_Part):
    """The whole left ventricle: volume (cm3), mass (g), tissue density (g/mL), flow (mL/s), number of points."""

    volume: float
    mass: float
    tissue_density: float
    flow: float
    points: int


class PerfusionTargets(_Part):
    """Target flows of the N outlets that perfuse the LV.

    `outlets` and `bc` name the outlets and their boundary conditions. `mean` (N,) mL/s and `covariance` (N, N)
    mL2/s2 are what calibration and posterior use: those of the noise model `use`, scaled to the relative standard
    deviation `branch_sd` if it is given. With `uncertainty: full`, `mean` is over all `rules` of territories (rule →
    weight), and `covariance` includes the `further` ones by source: calibration, territories, registration. `volume`
    (N,) cm3 and `baseline` (N,) mL/s belong to the noise-free territories.
    """

    outlets: list[str]
    bc: list[str]
    mean: Array
    covariance: Array
    volume: Array
    baseline: Array
    use: str
    branch_sd: float | None
    relative_sd: Array
    further: dict[str, Array] = {}
    rules: dict[str, float] = {}
    realisations: int
    models: dict[str, NoiseStatistics]
    lv: VentricleTotals
    provenance: dict[str, Any]


def read_perfusion_targets(path: str | Path) -> PerfusionTargets:
    """Read `targets.json`.

    Parameters
    ----------
    path : str or Path
        The file that `perfusion.stage.gather` writes.

    Returns
    -------
    PerfusionTargets
        Target flows, mL/s, and their covariance.

    Raises
    ------
    InputError
        If a field is missing, its size differs from the number of outlets, or a mean flow is not positive.
    """
    targets = checked(PerfusionTargets, read_json(path), path, REMEDY)
    n = len(targets.bc)
    for name, shape in (("mean", (n,)), ("covariance", (n, n)), ("volume", (n,))):
        actual = getattr(targets, name).shape
        if actual != shape:
            raise InputError(path, name, actual, f"expected {' by '.join(map(str, shape))} numbers; {REMEDY}")
    for bc, flow in zip(targets.bc, targets.mean.tolist(), strict=True):
        if not flow > 0.0:
            raise InputError(path, f"mean of {bc}", flow, "expected a positive flow")
    return targets


def supplied(targets: PerfusionTargets) -> np.ndarray:
    """Return the tissue (N,), cm3, that the target flows of the outlets supply.

    Volume and noise-free flow of a territory are those of the campaign's own rule, the target is the mean over all
    rules. A rule that gives an outlet more of the wall gives it more flow and more tissue; flow per tissue stays. An
    outlet to which the campaign's own rule gives nothing has the flow per tissue of the whole wall.
    """
    has = targets.baseline > 0.0
    per_flow = np.full_like(targets.mean, targets.volume.sum() / targets.baseline.sum())
    per_flow[has] = targets.volume[has] / targets.baseline[has]
    return per_flow * targets.mean


def of_borders(targets: PerfusionTargets) -> np.ndarray | None:
    """Return the covariance (N, N) of the logarithms of tissue and flow that borders of territories give the outlets.

    That of rules and registration; None where neither is uncertain.
    """
    found = np.zeros_like(targets.covariance)
    for source, flow in BORDERS.items():
        covariance = targets.further.get(source)
        if covariance is not None:
            # No outlet's flow is uncertain by more than itself.
            scale = np.maximum(getattr(targets, flow), np.sqrt(np.diag(covariance)))
            found = found + covariance / np.outer(scale, scale)
    return found if np.any(found) else None


def without_borders(targets: PerfusionTargets) -> np.ndarray:
    """Return the covariance (N, N) of the target flows, mL2/s2, for known borders of territories."""
    further = [targets.further[source] for source in BORDERS if source in targets.further]
    return targets.covariance - sum(further, np.zeros_like(targets.covariance))
