"""Perfusion maps in every form and unit that users have: the same wall and the same flow come out."""

import re
from contextlib import contextmanager

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.case.description.fields import Perfusion
from coronaryuq.case.perfusion.perfusion_map import read_wall
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MBF_PER_MIN_PER_G, TISSUE_DENSITY
from coronaryuq.figures import registration_picture as registration
from coronaryuq.figures.registration_picture import registration_picture
from coronaryuq.synthetic.ventricle import Ventricle

pytestmark = pytest.mark.slow

sitk = pytest.importorskip("SimpleITK")


def flow_field(points):
    """mL/min/g, between 1.4 and 2.6, linear in place: its integral is its value at the centroid times the volume."""
    return 2.0 + 0.08 * points[:, 0] - 0.05 * points[:, 1] + 0.06 * points[:, 2]


@pytest.fixture(scope="module")
def wall():
    return Ventricle().mesh(8_000)


def read(folder, most_cells=10**7, **fields):
    given = {"file": "map.vtu", "unit": "mL/min/g", "length_unit": "cm"} | fields
    return read_wall(folder / "case.yaml", Perfusion(**given), TISSUE_DENSITY, most_cells)


def total_flow(mesh):
    sizes = np.asarray(mesh.compute_cell_sizes(length=False, area=False, volume=True)["Volume"])
    return float(
        (sizes * flow_field(np.asarray(mesh.cell_centers().points))).sum() * MBF_PER_MIN_PER_G * TISSUE_DENSITY
    )


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("mL/min/g", 1.0),
        ("mL/min/100g", 100.0),
        ("mL/s/g", 1 / 60),
        ("mL/min/mL", TISSUE_DENSITY),
        ("mL/min/100mL", 100 * TISSUE_DENSITY),
    ],
)
@pytest.mark.parametrize(("length_unit", "scale"), [("cm", 1.0), ("mm", 10.0), ("m", 0.01)])
def test_every_unit_gives_the_same_flow(wall, tmp_path, unit, factor, length_unit, scale):
    mesh = wall.copy()
    mesh.cell_data["MBF"] = flow_field(mesh.cell_centers().points) * factor
    mesh.points = mesh.points * scale
    mesh.save(tmp_path / "map.vtu")
    found = read(tmp_path, unit=unit, length_unit=length_unit)
    assert found.flow(TISSUE_DENSITY) == pytest.approx(total_flow(wall), rel=1e-9)
    assert found.notes == ()


@pytest.mark.parametrize("name", ["map.vtu", "map.vtk"])
def test_point_data_of_a_linear_field_give_its_exact_integral(wall, tmp_path, name):
    mesh = wall.copy()
    mesh.point_data["MBF"] = flow_field(mesh.points)
    mesh.save(tmp_path / name)
    assert read(tmp_path, file=name).flow(TISSUE_DENSITY) == pytest.approx(total_flow(wall), rel=1e-6)


def test_missing_and_negative_values_take_their_nearest_neighbours_and_are_counted(wall, tmp_path):
    mesh = wall.copy()
    values = flow_field(np.asarray(mesh.cell_centers().points))
    bad = np.random.default_rng(0).choice(mesh.n_cells, 60, replace=False)
    values[bad[:40]], values[bad[40:]] = np.nan, -1.0
    mesh.cell_data["MBF"] = values
    mesh.save(tmp_path / "map.vtu")
    found = read(tmp_path)
    assert found.notes == (
        f"40 missing and 20 negative of {mesh.n_cells} cells were filled with the nearest valid value",
    )  # fmt: skip
    assert found.volume == pytest.approx(np.asarray(mesh.compute_cell_sizes()["Volume"]).sum(), rel=1e-9)
    assert found.flow(TISSUE_DENSITY) == pytest.approx(total_flow(wall), rel=1e-3)


def test_a_map_that_is_mostly_invalid_is_refused(wall, tmp_path):
    mesh = wall.copy()
    values = np.full(mesh.n_cells, 2.0)
    values[: mesh.n_cells // 3] = np.nan
    mesh.cell_data["MBF"] = values
    mesh.save(tmp_path / "map.vtu")
    with pytest.raises(InputError, match="more than 20 % are invalid"):
        read(tmp_path)


def test_label_and_threshold_cut_the_wall_out_of_what_surrounds_it(tmp_path):
    ring = pv.ImageData(dimensions=(41, 41, 31), spacing=(0.25,) * 3, origin=(-5, -5, 0)).cast_to_unstructured_grid()
    centres = np.asarray(ring.cell_centers().points)
    radius = np.hypot(centres[:, 0], centres[:, 1])
    inside = (radius > 2.0) & (radius < 3.0)
    island = (radius > 4.2) & (centres[:, 2] < 1.0) & (centres[:, 0] > 0)
    ring.cell_data["MBF"] = np.where(inside | island, 2.0, 0.1)
    ring.cell_data["part"] = np.where(inside, 5, np.where(island, 7, 0))
    ring.save(tmp_path / "map.vtu")
    by_label = read(tmp_path, array="MBF", label={"array": "part", "values": [5]})
    by_threshold = read(tmp_path, array="MBF", threshold=1.0)
    assert by_label.mesh.n_cells == by_threshold.mesh.n_cells == inside.sum()
    assert by_label.volume == pytest.approx(inside.sum() * 0.25**3, rel=1e-9)
    with pytest.raises(InputError, match=r"perfusion.label.values = \[9\]: selects no cell: map.vtu has 0, 5, 7"):
        read(tmp_path, array="MBF", label={"array": "part", "values": [9]})


def test_a_surface_has_no_volume_to_integrate_over(tmp_path):
    ball = pv.Sphere(radius=3.0)
    ball.cell_data["MBF"] = np.full(ball.n_cells, 2.0)
    ball.save(tmp_path / "map.vtp")
    with pytest.raises(InputError, match="no cell has a volume; expected tetrahedra, hexahedra or voxels"):
        read(tmp_path, file="map.vtp", array="MBF")


def test_cells_that_lie_upon_one_another_are_refused(wall, tmp_path):
    mesh = wall.copy()
    mesh.cell_data["MBF"] = np.full(mesh.n_cells, 2.0)
    pv.merge([mesh, mesh.extract_cells(range(7))], merge_points=False).save(tmp_path / "map.vtu")
    with pytest.raises(InputError, match="map.vtu: cells = 7: lie upon others; remove duplicates"):
        read(tmp_path, array="MBF")


def test_a_point_that_is_nowhere_is_told(wall, tmp_path):
    mesh = wall.copy()
    mesh.cell_data["MBF"] = np.full(mesh.n_cells, 2.0)
    mesh.points[5] = np.nan
    mesh.save(tmp_path / "map.vtu")
    with pytest.raises(InputError, match="map.vtu: points: a coordinate is not a finite number"):
        read(tmp_path, array="MBF")


def test_an_array_of_points_and_of_cells_is_noted_and_vtks_own_are_passed_over(wall, tmp_path):
    mesh = wall.copy()
    mesh.clear_data()
    mesh.cell_data["MBF"] = np.full(mesh.n_cells, 2.0)
    mesh.cell_data["vtkOriginalCellIds"] = np.arange(mesh.n_cells)
    mesh.point_data["MBF"] = np.full(mesh.n_points, 3.0)
    mesh.save(tmp_path / "map.vtu")
    found = read(tmp_path)
    assert "map.vtu: MBF is there at points and in cells; took the cells'" in found.notes
    assert found.mesh.cell_data["MBF"] == pytest.approx(2.0 / 60.0)


@pytest.mark.parametrize("name", ["map.vtk", "map.vti"])
def test_a_file_by_a_wrong_name_is_told_without_words_of_vtk(wall, tmp_path, capfd, caplog, name):
    wall.save(tmp_path / "map.vtu")
    (tmp_path / "map.vtu").rename(tmp_path / name)
    with pytest.raises(InputError, match=f"{name}: damaged, truncated, or of another type than its name says"):
        read(tmp_path, file=name)
    assert capfd.readouterr() == ("", "") and caplog.text == ""


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"unit": "mL/min/100mL"}, r"gives a median flow of 0.0\d+ mL/min/g, .*; the values would be plausible in mL"),
        ({"length_unit": "mm"}, "makes the wall 0.79 cm long; its points seem to be in cm"),
        ({"length_unit": "m"}, "makes the wall 7.. cm long; its points seem to be in cm"),
        ({"file": "map.csv"}, "unknown file type; known types: .vtu"),
        ({"file": "none.vtu"}, "no such file"),
        ({"affine": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]]}, "the matrix invertible"),
    ],
)  # fmt: skip
def test_an_impossible_map_is_reported(wall, tmp_path, fields, expected):
    mesh = wall.copy()
    mesh.cell_data["MBF"] = flow_field(mesh.cell_centers().points)
    mesh.save(tmp_path / "map.vtu")
    (tmp_path / "map.csv").write_text("x\n")
    with pytest.raises(InputError, match=expected):
        read(tmp_path, **fields)


# Images


ROTATION = np.array([[0.96, -0.28, 0.0], [0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])


def wall_image(spacing=2.0, transform=None):
    """A volume (mm) with the wall's flow inside and 0 outside, its label, on a turned and shifted grid."""
    shape = np.array([52, 52, 60])
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    origin = -ROTATION @ (shape * spacing / 2) + [0, 0, -40]
    position = index * spacing @ ROTATION.T + origin
    place = position if transform is None else position @ transform[:3, :3].T + transform[:3, 3]
    _, s, depth = Ventricle().coordinates(place / 10)
    inside = (depth >= 0) & (depth <= 1) & (place[:, 2] <= 0) & (s >= 0)
    values = np.where(inside, flow_field(place / 10), 0.0)
    volume, label = (
        sitk.GetImageFromArray(a.reshape(shape).transpose(2, 1, 0)) for a in (values, inside.astype(np.uint8))
    )
    for image in (volume, label):
        image.SetSpacing([spacing] * 3)
        image.SetOrigin(origin.tolist())
        image.SetDirection(ROTATION.ravel().tolist())
    return volume, label


@pytest.fixture(scope="module")
def images():
    return wall_image()


@pytest.mark.parametrize("suffix", [".nii.gz", ".nrrd"])
@pytest.mark.parametrize("by", ["label", "threshold"])
def test_an_image_gives_the_walls_volume_flow_and_place(images, wall, tmp_path, suffix, by):
    volume, label = images
    sitk.WriteImage(volume, str(tmp_path / f"map{suffix}"))
    sitk.WriteImage(label, str(tmp_path / f"label{suffix}"))
    cut = {"label": {"file": f"label{suffix}", "values": [1]}} if by == "label" else {"threshold": 0.5}
    found = read(tmp_path, file=f"map{suffix}", length_unit="mm", **cut)
    assert found.volume == pytest.approx(Ventricle().wall_volume, rel=0.01)
    assert found.flow(TISSUE_DENSITY) == pytest.approx(total_flow(wall), rel=0.01)
    weight = found.mesh.cell_data["Volume"]
    centre = (np.asarray(found.mesh.cell_centers().points) * weight[:, None]).sum(axis=0) / weight.sum()
    sizes = np.asarray(wall.compute_cell_sizes()["Volume"])
    expected = (np.asarray(wall.cell_centers().points) * sizes[:, None]).sum(axis=0) / sizes.sum()
    assert centre == pytest.approx(expected, abs=0.03)


def test_merging_voxels_keeps_volume_and_flow(images, tmp_path):
    sitk.WriteImage(images[0], str(tmp_path / "map.nrrd"))
    sitk.WriteImage(images[1], str(tmp_path / "label.nrrd"))
    label = {"file": "label.nrrd", "values": [1]}
    fine = read(tmp_path, file="map.nrrd", length_unit="mm", label=label)
    coarse = read(tmp_path, file="map.nrrd", length_unit="mm", label=label, most_cells=3000)
    assert coarse.mesh.n_cells <= 3000 < fine.mesh.n_cells
    assert coarse.volume == pytest.approx(fine.volume, rel=1e-9)
    assert coarse.flow(TISSUE_DENSITY) == pytest.approx(fine.flow(TISSUE_DENSITY), rel=1e-9)


def test_a_given_affine_brings_the_map_home(images, wall, tmp_path):
    turn = np.eye(4)
    turn[:3, :3] = 0.1 * np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    turn[:3, 3] = [3.0, -2.0, 1.0]
    sitk.WriteImage(images[0], str(tmp_path / "map.nrrd"))
    straight = read(tmp_path, file="map.nrrd", length_unit="mm", threshold=0.5)
    moved = read(tmp_path, file="map.nrrd", length_unit="mm", threshold=0.5, affine=turn.tolist())
    expected = np.asarray(straight.mesh.points) @ (10 * turn[:3, :3]).T + turn[:3, 3]
    assert np.asarray(moved.mesh.points) == pytest.approx(expected, abs=1e-9)
    assert moved.volume == pytest.approx(straight.volume, rel=1e-9)


@contextmanager
def saved_axes(monkeypatch):
    """Axes of the picture that is drawn."""
    shown, original = [], registration.saved

    @contextmanager
    def saved(output, **subplots):
        with original(output, **subplots) as (figure, axes):
            yield figure, axes
            shown.extend(axes)

    monkeypatch.setattr(registration, "saved", saved)
    yield shown


def chest(spacing, transform=None):
    """A volume (mm) with two ventricles, aorta and spine, no two alike: what tells one direction from another."""
    shape = np.array([48, 48, 48])
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    origin = -shape * spacing / 2 + [0.0, 0.0, -30.0]
    place = index * spacing + origin
    if transform is not None:
        place = place @ transform[:3, :3].T + transform[:3, 3]

    def blob(centre, axes):
        return 1 / (1 + np.exp(6 * (np.linalg.norm((place - centre) / axes, axis=1) - 1)))

    values = 1.0 * blob([0, 0, -35], [33, 33, 45]) + 0.8 * blob([0, 0, -30], [22, 22, 34])
    values += 0.6 * blob([-38, 8, -25], [22, 28, 34]) + 1.5 * blob([-12, -14, 15], [15, 15, 22])
    values += 0.9 * blob([-10, 52, -30], [14, 12, 60])
    image = sitk.GetImageFromArray(values.reshape(shape).transpose(2, 1, 0))
    image.SetSpacing([spacing] * 3)
    image.SetOrigin(origin.tolist())
    return image


def test_registration_finds_a_known_affine_to_a_fraction_of_a_voxel(images, tmp_path, monkeypatch):
    """One scan shows the chest where the anatomy has it; the other one turned, stretched, shifted, in other greys."""
    angle = np.radians(7.0)
    known = np.eye(4)
    known[:3, :3] = [
        [1.04 * np.cos(angle), -np.sin(angle), 0.02],
        [np.sin(angle), 0.97 * np.cos(angle), 0.0],
        [0.0, 0.03, 1.02],
    ]
    known[:3, 3] = [4.0, -3.0, 2.5]
    sitk.WriteImage(sitk.Exp(chest(3.0)), str(tmp_path / "angiogram.nrrd"))
    sitk.WriteImage(chest(3.0, known), str(tmp_path / "perfusion_scan.nrrd"))
    sitk.WriteImage(images[0], str(tmp_path / "map.nrrd"))
    plain = read(tmp_path, file="map.nrrd", length_unit="mm", threshold=0.5).mesh
    scans = {"fixed": "angiogram.nrrd", "moving": "perfusion_scan.nrrd"}
    placed = read(tmp_path, file="map.nrrd", length_unit="mm", threshold=0.5, registration=scans)
    found = placed.mesh
    expected = np.asarray(plain.points) * 10 @ known[:3, :3].T + known[:3, 3]
    off = np.linalg.norm(np.asarray(found.points) * 10 - expected, axis=1)
    assert off.max() < 1.0 and off.mean() < 0.5  # mm; voxels are 3 mm
    note = next(note for note in placed.notes if "parts of the heart" in note)
    assert float(re.search(r"shift by ([\d.]+) mm", note)[1]) < 1.0
    with saved_axes(monkeypatch) as axes:
        registration_picture(tmp_path / "angiogram.nrrd", 0.1, placed, tmp_path / "shown.png")
    drawn = np.concatenate([line.get_xydata() for line in axes[2].lines])
    points = np.asarray(found.points) * 10
    origin = np.asarray(sitk.ReadImage(str(tmp_path / "angiogram.nrrd")).GetOrigin())
    for k in range(2):  # the outline spans the wall, in cm from the scan's first voxel
        low, high = (points[:, k].min() - origin[k]) / 10, (points[:, k].max() - origin[k]) / 10
        assert low - 1e-6 <= drawn[:, k].min() < low + 0.5 and high - 0.5 < drawn[:, k].max() <= high + 1e-6


@pytest.mark.parametrize(("moving", "noted"), [("scan.nrrd", False), (None, True)])
def test_a_map_that_is_registered_by_itself_is_noted(images, tmp_path, monkeypatch, moving, noted):
    monkeypatch.setattr("coronaryuq.case.perfusion.perfusion_map.register", lambda *_: np.eye(4))
    sitk.WriteImage(images[0], str(tmp_path / "angiogram.nrrd"))
    sitk.WriteImage(images[0], str(tmp_path / "scan.nrrd"))
    sitk.WriteImage(images[0], str(tmp_path / "map.nrrd"))
    scans = {"fixed": "angiogram.nrrd", "moving": moving}
    found = read(tmp_path, file="map.nrrd", length_unit="mm", threshold=0.5, registration=scans)
    assert any("centimetres off; give `moving`" in note for note in found.notes) == noted


def test_a_label_on_another_grid_is_refused(images, tmp_path):
    sitk.WriteImage(images[0], str(tmp_path / "map.nrrd"))
    sitk.WriteImage(images[1][:-2], str(tmp_path / "label.nrrd"))
    with pytest.raises(InputError, match="differs from that of .*map.nrrd; resample it"):
        read(tmp_path, file="map.nrrd", length_unit="mm", label={"file": "label.nrrd", "values": [1]})


@pytest.mark.parametrize("suffix", [".nii.gz", ".nrrd"])
@pytest.mark.parametrize("by", ["label", "threshold"])
def test_voxels_without_a_value_are_counted_and_filled(images, wall, tmp_path, suffix, by):
    """Whether a format keeps NaN or its reader turns it into zero; and a threshold leaves no holes where they are."""
    volume, label = images
    values, inside = sitk.GetArrayFromImage(volume), sitk.GetArrayFromImage(label).astype(bool)
    bad = np.random.default_rng(0).choice(np.flatnonzero(inside), 600, replace=False)
    values.ravel()[bad[:400]], values.ravel()[bad[400:]] = np.nan, -1.0
    spoilt = sitk.GetImageFromArray(values)
    spoilt.CopyInformation(volume)
    sitk.WriteImage(spoilt, str(tmp_path / f"map{suffix}"))
    sitk.WriteImage(label, str(tmp_path / "label.nrrd"))
    cut = {"label": {"file": "label.nrrd", "values": [1]}} if by == "label" else {"threshold": 0.5}
    found = read(tmp_path, file=f"map{suffix}", length_unit="mm", **cut)
    assert found.flow(TISSUE_DENSITY) == pytest.approx(total_flow(wall), rel=0.015)
    if by == "label":
        assert found.notes == (
            f"400 missing and 200 negative of {inside.sum()} voxels were filled with the nearest valid value",
        )
    else:
        assert found.volume == pytest.approx(Ventricle().wall_volume, rel=0.015)


def test_a_threshold_leaves_no_holes_in_a_vtk_map(wall, tmp_path):
    mesh = wall.copy()
    values = flow_field(np.asarray(mesh.cell_centers().points))
    values[np.random.default_rng(0).choice(mesh.n_cells, 60, replace=False)] = np.nan
    mesh.cell_data["MBF"] = values
    mesh.save(tmp_path / "map.vtu")
    found = read(tmp_path, threshold=0.5)
    assert found.notes == (
        f"60 missing and 0 negative of {mesh.n_cells} cells were filled with the nearest valid value",
    )
    assert found.flow(TISSUE_DENSITY) == pytest.approx(total_flow(wall), rel=1e-3)


def test_a_label_mostly_off_the_map_is_refused(images, tmp_path):
    sitk.WriteImage(images[0], str(tmp_path / "map.nii"))
    sitk.WriteImage(sitk.BinaryDilate(images[1], [2, 2, 2]), str(tmp_path / "label.nii"))
    with pytest.raises(InputError, match="more than 20 % are invalid"):
        read(tmp_path, file="map.nii", length_unit="mm", label={"file": "label.nii", "values": [1]})


@pytest.mark.parametrize("select", ["label", "threshold"])
@pytest.mark.parametrize("thickness", [4, 7])
def test_points_and_cells_of_one_map_give_one_wall(tmp_path, select, thickness):
    """A slab between two planes of background, sampled at voxels' centres: as cells, and as points."""
    n, h = 16, 0.5
    wall = np.zeros((n, n, n))
    wall[2:-2, 2:-2, 3 : 3 + thickness] = 1.0
    flow = np.where(wall > 0, 2.0, 0.1)
    cells = pv.ImageData(dimensions=(n + 1, n + 1, n + 1), spacing=(h, h, h))
    points = pv.ImageData(dimensions=(n, n, n), spacing=(h, h, h), origin=(h / 2, h / 2, h / 2))
    for grid, data in ((cells, cells.cell_data), (points, points.point_data)):
        data["MBF"], data["label"] = flow.ravel(order="F"), wall.ravel(order="F")
        grid.save(tmp_path / f"{'cells' if grid is cells else 'points'}.vti")
    chosen = {"label": {"array": "label", "values": [1]}} if select == "label" else {"threshold": 1.0}
    found = [read(tmp_path, file=f"{name}.vti", array="MBF", **chosen) for name in ("cells", "points")]
    assert found[0].volume == pytest.approx(wall.sum() * h**3, rel=1e-9)
    assert found[1].volume == pytest.approx(found[0].volume, rel=1e-9)
    assert found[1].flow(TISSUE_DENSITY) == pytest.approx(found[0].flow(TISSUE_DENSITY), rel=1e-9)
