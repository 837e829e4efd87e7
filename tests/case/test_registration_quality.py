"""The error of a registration is estimated without knowing where the map lies, tried where that is known."""

import numpy as np
import pytest
import SimpleITK as sitk
from scipy.spatial.transform import Rotation
from scipy.stats import spearmanr

from coronaryuq.case.perfusion.registration_quality import agreement

SHAPE, SPACING = (44, 48, 44), 3.0
TRIALS = 12


def scan(path, random, parts, grey, transform=None):
    """Write a noisy scan (mm) of a chest; `transform` leads from its positions to the parts'."""
    index = np.stack(np.meshgrid(*(np.arange(n) for n in SHAPE), indexing="ij"), axis=-1).reshape(-1, 3)
    origin = -np.array(SHAPE) * SPACING / 2 + [0.0, 0.0, -30.0]
    place = index * SPACING + origin
    if transform is not None:
        place = place @ transform[:3, :3].T + transform[:3, 3]
    values = np.zeros(len(place))
    for height, centre, axes in parts:
        values += height / (1 + np.exp(6 * (np.linalg.norm((place - centre) / axes, axis=1) - 1)))
    values = grey(values) + 0.1 * random.normal(size=len(values))
    image = sitk.GetImageFromArray(values.reshape(SHAPE).transpose(2, 1, 0))
    image.SetSpacing([SPACING] * 3)
    image.SetOrigin(origin.tolist())
    sitk.WriteImage(image, str(path))


def body(random):
    """Heights, centres and axes of the parts of a chest, none like another's."""
    usual = (
        (1.0, [0, 0, -35], [33, 33, 45]), (0.8, [0, 0, -30], [22, 22, 34]), (0.6, [-38, 8, -25], [22, 28, 34]),
        (1.5, [-12, -14, 15], [15, 15, 22]), (0.9, [-10, 52, -30], [14, 12, 60]),
    )  # fmt: skip
    return [(h * random.uniform(0.7, 1.3), np.array(c) + random.normal(size=3), np.array(a)) for h, c, a in usual]


def wall(random):
    """Points of the left ventricle in the first scan, mm."""
    directions = random.normal(size=(300, 3))
    return directions / np.linalg.norm(directions, axis=1)[:, None] * [28, 28, 40] + [0, 0, -33]


def motion(random, turn, shift, stretch=0.0):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(np.radians(turn) * random.normal(size=3)).as_matrix()
    matrix[:3, :3] = matrix[:3, :3] @ np.diag(1 + stretch * random.normal(size=3))
    matrix[:3, 3] = shift * random.normal(size=3)
    return matrix


@pytest.mark.long
def test_the_shift_of_the_parts_is_the_error_of_the_map(tmp_path):
    """Known displacements up to some 15 mm: ranked, and estimated within a factor of two from half a voxel on."""
    random = np.random.default_rng(41)
    true, found = [], []
    for trial in range(TRIALS):
        parts, known = body(random), motion(random, 6.0, 6.0, 0.03)
        scan(tmp_path / "fixed.nrrd", random, parts, np.exp)
        scan(tmp_path / "moving.nrrd", random, parts, lambda values: values, known)
        size = 4.0 * (trial % 3) * random.uniform(0.3, 1.0)
        wrong = motion(random, 0.5 * size, size)
        points = wall(random)
        placed = points @ wrong[:3, :3].T + wrong[:3, 3]
        told = agreement(tmp_path / "fixed.nrrd", tmp_path / "moving.nrrd", wrong @ known, placed, 1.0)
        assert told.blocks == 8 and told.voxels > 5000
        true.append(float(np.sqrt(np.mean(np.sum((placed - points) ** 2, axis=1)))))
        found.append(told.shift)
    true, found = np.array(true), np.array(found)
    assert spearmanr(true, found).statistic > 0.8
    ratio = found[true > SPACING / 2] / true[true > SPACING / 2]
    assert (ratio > 0.5).all() and (ratio < 2.0).all()
    assert found[true < 1e-9].max() < SPACING / 2
