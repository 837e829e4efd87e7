"""What the header of a medical image says of position, axes, units and layers: readers fill in what is missing."""

import gzip
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coronaryuq.core.errors import InputError

SKEWED = 1e-3
"""Largest cosine of the angle between two axes of an image."""
LARGEST_HEADER = 1_000_000
"""bytes."""
NIFTI_UNITS = {1: "m", 2: "mm", 3: "um"}
ANATOMICAL = ("left-posterior-superior", "left-anterior-superior", "right-anterior-superior", "lps", "las", "ras")
"""Spaces of NRRD that say which way is left; ITK takes any other for LPS."""
EXPORT = "export it again with its position, for example as NIfTI from 3D Slicer"


@dataclass(frozen=True)
class Header:
    """What a header says.

    placed: whether it says where the image lies. axes: columns (3, 3) along the voxel axes, of every statement that it
    makes; none if it makes no statement. voxel: its lengths, none if it states none. layers: values per voxel. unit:
    length unit, None if it names none. notes: contradictions that were settled.
    """

    placed: bool
    axes: tuple[np.ndarray, ...] = ()
    voxel: tuple[float, ...] = ()
    layers: int = 1
    unit: str | None = None
    notes: tuple[str, ...] = ()


def read_header(path: Path) -> Header:
    """Read the header of a NIfTI, NRRD or MetaImage file.

    Raises
    ------
    InputError
        If it is none, or damaged.
    """
    name = path.name.lower()
    try:
        if name.endswith((".nii", ".nii.gz")):
            return _nifti(path)
        fields = _fields(path, ":" if name.endswith((".nrrd", ".nhdr")) else "=")
        return _nrrd(path, fields) if name.endswith((".nrrd", ".nhdr")) else _meta_image(fields)
    except InputError:
        raise
    except (OSError, EOFError, zlib.error, struct.error, ValueError, KeyError, IndexError):
        raise InputError(path, None, None, f"has no readable header; {EXPORT}") from None


def check_header(path: Path, header: Header, placed_otherwise: bool) -> None:
    """Raise `InputError` for a header that leaves open what the image shows, or where.

    placed_otherwise: whether `perfusion` itself places the image, by a matrix or a registration.
    """
    if header.layers > 1:
        remedy = "values per voxel (layers, channels or time frames); expected one: export a single layer"
        raise InputError(path, "header", header.layers, remedy)
    for axes in header.axes:
        unit = axes / np.maximum(np.linalg.norm(axes, axis=0), 1e-300)
        worst = float(np.abs(np.triu(unit.T @ unit, 1)).max())
        if worst > SKEWED:
            angle = 90.0 - np.degrees(np.arcsin(min(worst, 1.0)))
            remedy = (
                "axes are not at right angles (tilted gantry?): resample the image on a regular grid, for example with "
                "3D Slicer's Resample Scalar Volume"
            )
            raise InputError(path, "axes", f"{angle:.4g} degrees", remedy)
    sizes = [header.voxel, *(tuple(np.linalg.norm(axes, axis=0)) for axes in header.axes)]
    shown = " and ".join(dict.fromkeys(" x ".join(f"{x:.4g}" for x in size) for size in sizes)) or None
    if len(header.voxel) < 3 or not all(np.isfinite(x) and x > 0 for size in sizes for x in size):
        raise InputError(path, "voxel size", shown, f"expected three positive lengths in the header; {EXPORT}")
    if any(not np.allclose(size, header.voxel[:3], rtol=0.01) for size in sizes[1:]):
        raise InputError(path, "voxel size", shown, f"the header's own statements differ; {EXPORT}")
    if not header.placed and not placed_otherwise:
        remedy = (
            f"the header does not say where the image lies; {EXPORT}, or give perfusion.affine or perfusion.transform"
        )
        raise InputError(path, "position", None, remedy)


def _nifti(path: Path) -> Header:
    with open(path, "rb") as file:
        first = file.read(4)
    compressed = first.startswith(b"\x1f\x8b")
    plain = any(int.from_bytes(first, order) in (348, 540) for order in ("little", "big"))
    if (compressed or plain) and compressed != path.name.lower().endswith(".gz"):
        raise InputError(
            path, None, None, f"is {'' if compressed else 'not '}compressed, unlike its name says; rename it"
        )
    with gzip.open(path, "rb") if compressed else open(path, "rb") as file:
        start = file.read(540)
    order = "<" if struct.unpack("<i", start[:4])[0] in (348, 540) else ">"
    if struct.unpack(f"{order}i", start[:4])[0] not in (348, 540):
        raise ValueError("neither NIfTI-1 nor NIfTI-2")
    if struct.unpack(f"{order}i", start[:4])[0] == 348:
        dim = struct.unpack(f"{order}8h", start[40:56])
        spacing = struct.unpack(f"{order}8f", start[76:108])
        codes = struct.unpack(f"{order}2h", start[252:256])
        quaternion, rows = struct.unpack(f"{order}6f", start[256:280]), struct.unpack(f"{order}12f", start[280:328])
        units = start[123]
        bits, offset = struct.unpack(f"{order}h", start[72:74])[0], int(struct.unpack(f"{order}f", start[108:112])[0])
    else:
        dim = struct.unpack(f"{order}8q", start[16:80])
        spacing = struct.unpack(f"{order}8d", start[104:168])
        codes = struct.unpack(f"{order}2i", start[344:352])
        quaternion, rows = struct.unpack(f"{order}6d", start[352:400]), struct.unpack(f"{order}12d", start[400:496])
        units = struct.unpack(f"{order}i", start[500:504])[0]
        bits, offset = struct.unpack(f"{order}h", start[14:16])[0], struct.unpack(f"{order}q", start[168:176])[0]
    _check_whole(path, compressed, offset + int(np.prod(dim[1 : dim[0] + 1], dtype=int)) * bits // 8)
    layers = int(np.prod([n for n in dim[4 : dim[0] + 1] if n > 1], dtype=int)) if dim[0] > 3 else 1
    affines = []
    if codes[1] > 0:
        affines.append(np.array(rows).reshape(3, 4))
    if codes[0] > 0:
        affines.append(_of_quaternion(quaternion, spacing))
    notes: tuple[str, ...] = ()
    if len(affines) == 2:
        ends = np.array([[(n - 1) * (k >> axis & 1) for axis, n in enumerate(dim[1:4])] + [1] for k in range(8)])
        apart = float(np.linalg.norm(ends @ (affines[0] - affines[1]).T, axis=1).max())
        if apart > 0.5 * min(abs(s) for s in spacing[1:4]):
            notes = (f"{path.name}: its two positions (sform, qform) are up to {apart:.3g} apart; the reader took one",)
    axes = tuple(affine[:, :3] for affine in affines)
    return Header(bool(affines), axes, tuple(spacing[1:4]), layers, NIFTI_UNITS.get(units & 7), notes)


def _check_whole(path: Path, compressed: bool, needed: int) -> None:
    """Raise `InputError` if a NIfTI file ends before its data do: readers fill the rest with zeros."""
    size = 0
    try:
        if compressed:
            with gzip.open(path, "rb") as file:
                while block := file.read(1 << 20):
                    size += len(block)
        else:
            size = path.stat().st_size
    except (EOFError, zlib.error, gzip.BadGzipFile):
        size = min(size, needed - 1)
    if size < needed:
        raise InputError(path, None, None, "damaged or truncated; copy or export it again")


def _of_quaternion(quaternion, spacing) -> np.ndarray:
    """Return the matrix (3, 4) of NIfTI's qform."""
    b, c, d, *offset = quaternion
    a = np.sqrt(max(0.0, 1.0 - b * b - c * c - d * d))
    turn = np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c],
        ]
    )
    scale = np.array(spacing[1:4]) * [1, 1, -1 if spacing[0] < 0 else 1]
    return np.column_stack([turn * scale, offset])


def _fields(path: Path, separator: str) -> dict[str, str]:
    """Return the fields of a text header, which ends at an empty line or where the data begin."""
    fields: dict[str, str] = {}
    with open(path, "rb") as file:
        for raw in file.read(LARGEST_HEADER).split(b"\n"):
            line = raw.decode("latin-1").rstrip("\r")
            if separator == ":" and not line:
                break
            key, found, value = line.partition(separator)
            if found:
                fields.setdefault(key.strip().lower(), value.strip())
            if separator == "=" and key.strip() == "ElementDataFile":
                break
    return fields


def _nrrd(path: Path, fields: dict[str, str]) -> Header:
    sizes = [int(n) for n in fields["sizes"].split()]
    kinds = fields.get("kinds", "").split()
    directions = [part for part in fields.get("space directions", "").replace("none", "|none|").split() if part]
    vectors = [np.array([float(x) for x in part.strip("()").split(",")]) for part in directions if part[0] == "("]
    spatial = len(vectors) or sum(kind in ("domain", "space") for kind in kinds) or min(3, len(sizes))
    layers = int(np.prod(sizes, dtype=int))
    of_space = [n for n, part in zip(sizes, directions, strict=False) if part[0] == "("] or sizes[-spatial:]
    layers //= max(1, int(np.prod(of_space, dtype=int)))
    axes = (np.column_stack(vectors),) if len(vectors) == 3 and all(len(v) == 3 for v in vectors) else ()
    placed = fields.get("space", "").lower() in ANATOMICAL and "space origin" in fields and len(vectors) == 3
    stated = [float(x) for x in fields.get("spacings", "").split() if x.lower() != "nan"]
    voxel = tuple(np.linalg.norm(axes[0], axis=0)) if axes else tuple(stated)
    units = fields.get("space units", "").replace('"', " ").split()
    return Header(placed, axes, voxel, layers, units[0] if units and len(set(units)) == 1 else None)


def _meta_image(fields: dict[str, str]) -> Header:
    sizes = [int(n) for n in fields["dimsize"].split()]
    layers = int(fields.get("elementnumberofchannels", "1")) * int(np.prod([n for n in sizes[3:] if n > 1], dtype=int))
    placed = any(name in fields for name in ("offset", "position", "origin"))
    turn = next((fields[n] for n in ("transformmatrix", "rotation", "orientation") if n in fields), None)
    number = len(sizes)
    axes: tuple[np.ndarray, ...] = ()
    if turn is not None and number == 3:
        axes = (np.array([float(x) for x in turn.split()]).reshape(3, 3).T,)
    voxel = tuple(float(x) for x in fields.get("elementspacing", fields.get("elementsize", "")).split())
    axes = tuple(turned / np.linalg.norm(turned, axis=0) * voxel[:3] for turned in axes if len(voxel) >= 3)
    return Header(placed, axes, voxel, layers)
