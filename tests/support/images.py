"""Images of a slab of heart, with headers as scanners and converters write them, or forget to."""

import gzip
import struct
from pathlib import Path

import numpy as np

SIDE, SPACING = 18, 5.0
ORIGIN = np.array([-42.5, -42.5, -82.5])


def shell(inner=20.0, outer=40.0) -> np.ndarray:
    """Return a hollow ball of flow 2, in a box of zeros: (i, j, k)."""
    grid = np.stack(np.meshgrid(*3 * [np.arange(SIDE)], indexing="ij"), axis=-1) * SPACING
    radius = np.linalg.norm(grid - (SIDE - 1) * SPACING / 2, axis=-1)
    return np.where((radius > inner) & (radius < outer), 2.0, 0.0).astype("<f4")


def nifti(
    path: Path, values, codes=(0, 1), skew=0.0, unit=2, order="<", frames=1, qform_shift=0.0, voxel=SPACING
) -> None:
    """Write NIfTI-1; x and y of its RAS axes are reversed, so that they run as those of LPS."""
    header = bytearray(352)
    struct.pack_into(f"{order}i", header, 0, 348)
    struct.pack_into(f"{order}8h", header, 40, 4 if frames > 1 else 3, *values.shape, frames, 1, 1, 1)
    struct.pack_into(f"{order}2h", header, 70, 16, 32)
    struct.pack_into(f"{order}8f", header, 76, 1.0, voxel, SPACING, SPACING, 1, 1, 1, 1)
    struct.pack_into(f"{order}3f", header, 108, 352.0, 1.0, 0.0)
    header[123] = unit
    struct.pack_into(f"{order}2h", header, 252, *codes)
    x, y, z = -ORIGIN[0], -ORIGIN[1], ORIGIN[2]
    struct.pack_into(f"{order}6f", header, 256, 0, 0, 1, x + qform_shift, y, z)
    rows = [-SPACING, skew, 0, x, 0, -SPACING, 0, y, 0, 0, SPACING, z]
    struct.pack_into(f"{order}12f", header, 280, *rows)
    header[344:348] = b"n+1\0"
    data = np.asarray(values, f"{order}f4").tobytes(order="F") * frames
    content = bytes(header) + data
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)


def nrrd(path: Path, values, space="left-posterior-superior", origin=True, skew=0.0, layers=1) -> None:
    """Write NRRD, by default in LPS."""
    none, sizes = "none " if layers > 1 else "", [layers, *values.shape] if layers > 1 else values.shape
    lines = ["NRRD0005", "type: float", f"dimension: {len(sizes)}", f"sizes: {' '.join(map(str, sizes))}"]
    lines += ["endian: little", "encoding: raw"]
    lines += [] if space else [f"spacings: {SPACING} {SPACING} {SPACING}"]
    if space:
        lines += [f"space: {space}", f"space directions: {none}({SPACING},0,0) ({skew},{SPACING},0) (0,0,{SPACING})"]
        lines += [f"kinds: {'list ' if layers > 1 else ''}domain domain domain"]
    if origin and space:
        lines += [f"space origin: ({','.join(map(str, ORIGIN))})"]
    data = np.repeat(np.asarray(values, "<f4").ravel(order="F"), layers)
    path.write_bytes("\n".join([*lines, "", ""]).encode() + data.tobytes())


def meta_image(path: Path, values, offset=True, skew=0.0, channels=1, voxel=SPACING) -> None:
    """Write a MetaImage."""
    lines = ["ObjectType = Image", "NDims = 3", "BinaryData = True", "BinaryDataByteOrderMSB = False"]
    lines += [f"TransformMatrix = 1 0 0 {skew} 1 0 0 0 1"] if offset or skew else []
    lines += [f"Offset = {' '.join(map(str, ORIGIN))}"] if offset else []
    lines += [] if voxel is None else [f"ElementSpacing = {voxel} {SPACING} {SPACING}"]
    lines += [f"DimSize = {' '.join(map(str, values.shape))}"]
    lines += [f"ElementNumberOfChannels = {channels}"] if channels > 1 else []
    lines += ["ElementType = MET_FLOAT", "ElementDataFile = LOCAL", ""]
    data = np.repeat(np.asarray(values, "<f4").ravel(order="F"), channels)
    path.write_bytes("\n".join(lines).encode() + data.tobytes())
