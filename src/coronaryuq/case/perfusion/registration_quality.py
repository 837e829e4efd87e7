"""How far a registered perfusion map may lie off, where nobody knows where it lies."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from coronaryuq.case.perfusion.images import read_scan

MARGIN = 12.0
"""mm around the wall of what is registered again: its neighbours tell where it lies, too."""
OVERLAP = 0.15
"""Fraction of a side by which a block reaches beyond the middle."""
FINEST_BLOCK = 200_000
"""Approximate number of voxels of a block at the finest level; more do not improve three parameters."""
STATED = 3.0
"""mm: the default of `errors.registration`, in each direction."""


@dataclass(frozen=True)
class Agreement:
    """How far the parts of the heart shift when each is registered by itself: root mean square, mm.

    voxels: of the fixed image in all parts. blocks: number of parts that could be registered, of eight.
    """

    shift: float
    voxels: int
    blocks: int

    @property
    def note(self) -> str:
        """The note for the user."""
        if self.blocks < 4:
            return "perfusion.registration: its error could not be estimated: the scans hardly overlap at the heart"
        said = (
            f"perfusion.registration: parts of the heart, each registered by itself, shift by {self.shift:.2g} mm "
            f"(root mean square of {self.blocks} parts, {self.voxels} voxels), about how far the map lies off"
        )
        each = self.shift / np.sqrt(3)
        if each <= STATED:
            return said
        return f"{said}; look at the picture, and give errors.registration {each:.2g} (mm in each direction) or more"


def agreement(
    fixed: str | Path, moving: str | Path, matrix: np.ndarray, points: np.ndarray, millimetre: float
) -> Agreement:
    """Return how well two registered scans agree around the wall.

    The box around the wall is cut into eight overlapping blocks. Each is shifted until its mutual information with the
    moving scan is largest. Where the registration is right and the scans show the same, the blocks stay where they are;
    where it is wrong, or the scans have too little in common to tell, they move. Of made pairs of scans, with
    displacements and without, the root mean square of the shifts is the wall's true error within a factor of about two
    (`tests/case/test_registration_quality.py`).

    Parameters
    ----------
    fixed, moving
        The two scans.
    matrix
        (4, 4) from positions in the moving scan to those in the fixed one.
    points
        (n, 3) of the wall, positions in the fixed scan.
    millimetre
        Length of a millimetre in the unit of the positions.
    """
    import SimpleITK as sitk

    target, source = read_scan(fixed), read_scan(moving)
    inverse = np.linalg.inv(matrix)
    placed = sitk.AffineTransform(3)
    placed.SetMatrix(inverse[:3, :3].ravel().tolist())
    placed.SetTranslation(inverse[:3, 3].tolist())
    spacing, size = np.array(target.GetSpacing()), np.array(target.GetSize())
    index = (points - target.GetOrigin()) @ np.array(target.GetDirection()).reshape(3, 3) / spacing
    margin = MARGIN * millimetre / spacing
    low, high = index.min(axis=0) - margin, index.max(axis=0) + margin
    shifts, voxels = [], 0
    for sides in product((0, 1), repeat=3):
        lower = np.array(sides) * (0.5 - OVERLAP)
        first = np.clip(np.floor(low + lower * (high - low)), 0, size - 1).astype(int)
        last = np.clip(np.ceil(low + (lower + 0.5 + OVERLAP) * (high - low)), first, size - 1).astype(int)
        count = last - first + 1
        if (count < 4).any():
            continue
        block = sitk.RegionOfInterest(target, count.tolist(), first.tolist())
        try:
            shifts.append(_shift(block, source, placed))
        except RuntimeError:  # it does not overlap with the moving scan
            continue
        voxels += int(count.prod())
    rms = float(np.sqrt(np.mean(np.square(shifts)))) / millimetre if shifts else np.inf
    return Agreement(rms, voxels, len(shifts))


def _shift(block, source, placed) -> float:
    """Return by how far a block moves when its mutual information with the source is maximised."""
    import SimpleITK as sitk

    finest = max(1, round((block.GetNumberOfPixels() / FINEST_BLOCK) ** (1 / 3)))
    method = sitk.ImageRegistrationMethod()
    method.SetMetricAsMattesMutualInformation(numberOfHistogramBins=24)
    method.SetMetricSamplingStrategy(method.NONE)
    method.SetInterpolator(sitk.sitkLinear)
    method.SetOptimizerAsRegularStepGradientDescent(
        learningRate=2.0 * float(np.mean(block.GetSpacing())) / 3.0, minStep=1e-3, numberOfIterations=100,
        gradientMagnitudeTolerance=1e-9,
    )  # fmt: skip
    method.SetOptimizerScalesFromPhysicalShift()
    method.SetShrinkFactorsPerLevel([2 * finest, finest])
    method.SetSmoothingSigmasPerLevel([finest, finest / 2])
    method.SmoothingSigmasAreSpecifiedInPhysicalUnitsOff()
    method.SetMovingInitialTransform(placed)
    shift = sitk.TranslationTransform(3)
    method.SetInitialTransform(shift, inPlace=True)
    method.SetGlobalDefaultNumberOfThreads(1)
    method.Execute(block, source)
    return float(np.linalg.norm(shift.GetParameters()))
