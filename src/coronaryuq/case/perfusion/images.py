"""Medical images (NIfTI, NRRD): reading, extraction of the wall, and affine registration."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from coronaryuq.case.perfusion.image_headers import EXPORT, Header, check_header, read_header
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.quiet import quiet

if TYPE_CHECKING:
    import SimpleITK as sitk

IMAGE_SUFFIXES = (".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd")
LARGEST = 600_000_000
"""Maximum number of voxels."""
FINEST = 2_000_000
"""Approximate number of voxels of a registration's last level; more do not improve twelve parameters."""


@dataclass(frozen=True)
class Image:
    """A scalar volume. values: (i, j, k). matrix: (4, 4), from voxel index to position in the file's length unit.

    unit: length unit of positions if the header names one, else None. stated: the unit in the header, which may be
    another one, from which positions were converted. notes: of the header's contradictions.
    """

    values: np.ndarray
    matrix: np.ndarray
    unit: str | None = None
    notes: tuple[str, ...] = ()
    stated: str | None = None


@dataclass(frozen=True)
class Invalid:
    """Cells or voxels of the wall without a usable value: missing and negative, their total number, and their kind."""

    missing: int
    negative: int
    among: int
    kind: str

    def __str__(self) -> str:
        return f"{self.missing} missing and {self.negative} negative of {self.among} {self.kind}"


def read_image(
    path: str | Path, like: Image | None = None, path_like: str | Path = "", placed_otherwise: bool = False
) -> Image:
    """Read a volume; positions are LPS, as SimpleITK gives them for every format.

    like: an image that must have the same grid (else InputError). placed_otherwise: whether a matrix or a registration
    places the image, so that its header need not. Raises InputError for a missing or foreign file, a header without
    position or with skewed axes, an image of several layers or of two dimensions, and an implausibly large one.
    """
    import SimpleITK as sitk

    path = Path(path)
    header = _checked_header(path, placed_otherwise)
    image = _read(path)
    if image.GetDimension() == 4:
        image = image[:, :, :, 0]
    if image.GetDimension() != 3 or image.GetNumberOfComponentsPerPixel() != 1:
        raise InputError(path, "size", image.GetSize(), "expected a 3D image with one value per voxel")
    values = np.asarray(sitk.GetArrayFromImage(image)).transpose(2, 1, 0)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array(image.GetDirection()).reshape(3, 3) * np.array(image.GetSpacing())
    matrix[:3, 3] = image.GetOrigin()
    if like is not None and (values.shape != like.values.shape or not np.allclose(matrix, like.matrix, atol=1e-3)):
        raise InputError(path, "grid", values.shape, f"differs from that of {path_like}; resample it onto that grid")
    # ITK converts the lengths of a NIfTI file to mm.
    nifti = path.name.lower().endswith((".nii", ".nii.gz"))
    return Image(values, matrix, "mm" if nifti and header.unit else header.unit, header.notes, header.unit)


def check_file(path: Path) -> None:
    """Raise `InputError` if there is no such file."""
    if path.is_dir():
        raise InputError(
            path, None, None, "is a folder; name a file (DICOM: convert the series to NIfTI, as by 3D Slicer)"
        )
    if not path.is_file():
        raise InputError(path, None, None, "no such file")


def _checked_header(path: Path, placed_otherwise: bool) -> Header:
    check_file(path)
    header = read_header(path)
    check_header(path, header, placed_otherwise)
    return header


def _read(path: Path):
    """Read an image with SimpleITK, which keeps its own remarks to itself; `InputError` if it cannot."""
    import SimpleITK as sitk

    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    try:
        with quiet():
            reader.ReadImageInformation()
        if int(np.prod(reader.GetSize(), dtype=float)) > LARGEST:
            raise InputError(path, "size", reader.GetSize(), f"more than {LARGEST} voxels; crop the image")
        if "complex" in sitk.GetPixelIDValueAsString(reader.GetPixelID()):
            raise InputError(path, "values", None, "are complex numbers; export their magnitude")
        with quiet():
            return reader.Execute()
    except RuntimeError:
        remedy = f"damaged, truncated, or of another type than its name says; {EXPORT}"
        raise InputError(path, None, None, remedy) from None


def wall_cells(file, image: Image, label: np.ndarray | None, threshold: float | None, most_cells: int):
    """Return the wall as a pyvista grid of voxels, with its numbers of missing and of negative values.

    The grid is in the image's space and length unit, with cell data `value`. The wall consists of the voxels `label`
    (bool), or of the largest connected part above `threshold`, or of every positive value. A threshold would leave
    holes where values are invalid, so an invalid voxel with four or more of its six neighbours in that part belongs to
    it. A wall voxel of exactly zero counts as missing, because NIfTI readers turn NaN into zero. Voxels are merged in
    blocks of 2 x 2 x 2, 3 x 3 x 3, ... until at most `most_cells` remain; a block has the mean of its valid voxels (NaN
    without any) and the volume of all its wall voxels.
    """
    import pyvista as pv

    values = np.asarray(image.values, dtype=float)
    valid = np.isfinite(values) & (values > 0)
    if label is not None:
        inside, field = label, "perfusion.label.values"
    elif threshold is not None:
        inside, field = _largest_above(values, threshold, valid), "perfusion.threshold"
    else:
        inside, field = valid, "perfusion.file"
    if not inside.any():
        remedy = "selects no voxel of the map" if field != "perfusion.file" else "the map has no positive value"
        raise InputError(file, field, threshold, remedy)
    invalid = inside & ~valid
    negative = int(np.count_nonzero(values[invalid] < 0))
    factor = 1
    while np.count_nonzero(_blocks(inside, factor, np.any)) > most_cells:
        factor += 1
    share = _blocks(inside.astype(float), factor, np.mean)
    valid &= inside
    total = _blocks(np.where(valid, values, 0.0), factor, np.sum)
    count = _blocks(valid.astype(float), factor, np.sum)
    blocks = np.argwhere(share > 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        merged = (total / count)[tuple(blocks.T)]
    # Hexahedra, because VTK assumes that voxels lie along the axes, and images are often rotated.
    square = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
    half = (share[tuple(blocks.T)] ** (1 / 3))[:, None, None] * np.array(
        [[x, y, z] for z in (-0.5, 0.5) for x, y in square]
    )
    corners = (blocks[:, None, :] + 0.5 + half) * factor - 0.5
    points = corners.reshape(-1, 3) @ image.matrix[:3, :3].T + image.matrix[:3, 3]
    grid = pv.UnstructuredGrid({pv.CellType.HEXAHEDRON: np.arange(len(points)).reshape(-1, 8)}, points)
    grid.cell_data["value"] = merged
    return grid, Invalid(int(invalid.sum()) - negative, negative, int(inside.sum()), "voxels")


def _largest_above(values: np.ndarray, threshold: float, valid: np.ndarray) -> np.ndarray:
    """Select the largest part of the voxels above the threshold, with the invalid ones that it nearly encloses."""
    from scipy import ndimage

    parts, count = ndimage.label(valid & (values > threshold))
    if not count:
        return parts > 0
    part = parts == 1 + int(np.argmax(np.bincount(parts.ravel())[1:]))
    around = ndimage.generate_binary_structure(3, 1).astype(np.uint8)
    return part | (~valid & (ndimage.convolve(part.astype(np.uint8), around, mode="constant") >= 4))


def _blocks(values: np.ndarray, factor: int, reduce) -> np.ndarray:
    if factor == 1:
        return values
    padded = np.pad(values, [(0, -n % factor) for n in values.shape])
    i, j, k = (n // factor for n in padded.shape)
    return reduce(padded.reshape(i, factor, j, factor, k, factor), axis=(1, 3, 5))


def register(file, fixed: str | Path, moving: str | Path) -> np.ndarray:
    """Register two images; return the matrix (4, 4) from positions in the moving image to those in the fixed one.

    Positions are in each image's length unit. The centres of mass are aligned first; then a rigid and an affine map
    maximise the mutual information (Mattes et al. 2003) from coarse to fine. Every voxel is sampled, by one thread, so
    that the same images give the same matrix. Raises InputError if the images cannot be registered.
    """
    import SimpleITK as sitk

    for path in (fixed, moving):
        if not Path(path).is_file():
            raise InputError(file, "perfusion.registration", str(path), "no such file")
        # The fixed image says where the anatomy lies; where the moving one lies does not matter.
        _checked_header(Path(path), placed_otherwise=path is moving)
    target, source = read_scan(fixed), read_scan(moving)
    rigid = sitk.CenteredTransformInitializer(
        target, source, sitk.Euler3DTransform(), sitk.CenteredTransformInitializerFilter.MOMENTS
    )
    finest = max(1, round((target.GetNumberOfPixels() / FINEST) ** (1 / 3)))
    try:
        rigid = sitk.Euler3DTransform(_fitted(target, source, rigid, [2 * finest]))
        start = sitk.AffineTransform(3)
        start.SetMatrix(rigid.GetMatrix())
        start.SetCenter(rigid.GetCenter())
        start.SetTranslation(rigid.GetTranslation())
        affine = _fitted(target, source, start, [2 * finest, finest])
    except RuntimeError:
        remedy = "the images could not be registered: do they show the same region? If so, give perfusion.affine"
        raise InputError(file, "perfusion.registration", str(moving), remedy) from None
    forward = np.array([affine.TransformPoint(p) for p in np.vstack([np.zeros(3), np.eye(3)])])
    # SimpleITK's transform maps fixed to moving positions; the map needs the inverse.
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = (forward[1:] - forward[0]).T, forward[0]
    return np.linalg.inv(matrix)


def read_scan(path: str | Path) -> "sitk.Image":
    """Read an image of a registration, with 0 for what is not finite; its header has been checked."""
    import SimpleITK as sitk

    return sitk.Cast(_finite(_read(Path(path))), sitk.sitkFloat32)


def _fitted(target, source, start, levels: list[int]):
    """Fit a transform of the type of `start` to images shrunk by each of `levels` in turn."""
    import SimpleITK as sitk

    method = sitk.ImageRegistrationMethod()
    method.SetMetricAsMattesMutualInformation(numberOfHistogramBins=32)
    method.SetMetricSamplingStrategy(method.NONE)
    method.SetInterpolator(sitk.sitkLinear)
    method.SetOptimizerAsRegularStepGradientDescent(
        learningRate=0.5, minStep=1e-4, numberOfIterations=200, gradientMagnitudeTolerance=1e-9
    )
    method.SetOptimizerScalesFromPhysicalShift()
    method.SetShrinkFactorsPerLevel(levels)
    method.SetSmoothingSigmasPerLevel([level / 2 for level in levels])
    method.SmoothingSigmasAreSpecifiedInPhysicalUnitsOff()
    method.SetInitialTransform(start, inPlace=False)
    method.SetGlobalDefaultNumberOfThreads(1)
    fitted = method.Execute(target, source)
    return fitted.GetNthTransform(0) if isinstance(fitted, sitk.CompositeTransform) else fitted


def _finite(image):
    import SimpleITK as sitk

    values = sitk.GetArrayFromImage(image)
    if not np.issubdtype(values.dtype, np.floating) or np.isfinite(values).all():
        return image
    finite = sitk.GetImageFromArray(np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0))
    finite.CopyInformation(image)
    return finite
