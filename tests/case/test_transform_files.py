"""A transform file of ITK or 3D Slicer brings the map to the anatomy; what is none is refused in one line."""

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.case.assembly import assemble
from coronaryuq.case.description.dependencies import files_named
from coronaryuq.case.description.fields import read_description
from coronaryuq.case.perfusion.transform_files import read_transform
from coronaryuq.case.settings import Settings
from coronaryuq.core.errors import InputError
from support.case_files import check_case, small_tree, write_case

sitk = pytest.importorskip("SimpleITK")

PERFUSION = "{{file: lv.vtu, array: MBF, unit: mL/min/g, length_unit: {unit}, transform: {file}}}"


def rigid():
    """From positions in the anatomy to those in the map, mm."""
    transform = sitk.Euler3DTransform()
    transform.SetRotation(0.4, -0.3, 0.9)
    transform.SetCenter((10.0, 0.0, -40.0))
    transform.SetTranslation((60.0, -80.0, 50.0))
    return transform


def stretched():
    transform = sitk.AffineTransform(3)
    transform.SetMatrix((1.05, 0.1, 0.0, -0.1, 0.95, 0.05, 0.0, 0.0, 1.02))
    transform.SetTranslation((70.0, -20.0, 10.0))
    return transform


def of_both():
    return sitk.CompositeTransform([rigid(), stretched()])


def move_map(folder, transform, unit_mm: float) -> np.ndarray:
    """Write the case's map where it was scanned, in units of `unit_mm`, and return its points in the anatomy, cm."""
    mesh = pv.read(folder / "lv.vtu")
    home = np.asarray(mesh.points, dtype=float).copy()
    mesh.points = np.array([transform.TransformPoint(p) for p in (10 * home).tolist()]) / unit_mm
    mesh.save(folder / "lv.vtu")
    return home


@pytest.mark.parametrize("made", [rigid, stretched, of_both])
@pytest.mark.parametrize("suffix", [".tfm", ".h5", ".txt"])
@pytest.mark.parametrize(("unit", "mm"), [("cm", 10.0), ("mm", 1.0)])
def test_a_map_is_brought_to_the_anatomy(tmp_path, made, suffix, unit, mm):
    path = write_case(tmp_path, small_tree(), perfusion=PERFUSION.format(unit=unit, file=f"to{suffix}"))
    home = move_map(tmp_path, made(), mm)
    sitk.WriteTransform(made(), str(tmp_path / f"to{suffix}"))
    case = assemble(path, Settings())
    assert np.asarray(case.wall.mesh.points) == pytest.approx(home, abs=1e-4)  # VTK keeps single precision
    assert tmp_path / f"to{suffix}" in files_named(path, read_description(path))


def test_the_inverse_of_a_file_is_told(tmp_path):
    path = write_case(tmp_path, small_tree(), perfusion=PERFUSION.format(unit="cm", file="to.tfm"))
    move_map(tmp_path, rigid(), 10.0)
    sitk.WriteTransform(rigid().GetInverse(), str(tmp_path / "to.tfm"))
    (line,) = check_case(path)[0]
    assert line.startswith(f"{path}: perfusion.transform = 'to.tfm': the wall lies ") and "Save the inverse" in line


def test_a_file_as_3d_slicer_writes_it_is_read(tmp_path):
    (tmp_path / "slicer.tfm").write_text(
        "#Insight Transform File V1.0\n#Transform 0\nTransform: AffineTransform_double_3_3\n"
        "Parameters: 0 1 0 -1 0 0 0 0 1 5 6 7\nFixedParameters: 0 0 0\n"
    )
    expected = [[0, 1, 0, 5], [-1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]
    assert np.array_equal(read_transform(tmp_path / "case.yaml", "slicer.tfm"), expected)


def bent(path):
    sitk.WriteTransform(sitk.BSplineTransformInitializer(sitk.Image(8, 8, 8, sitk.sitkFloat32), [2, 2, 2]), path)


def flat(path):
    sitk.WriteTransform(sitk.Euler2DTransform(), path)


def singular(path):
    transform = sitk.AffineTransform(3)
    transform.Scale(1e-7)
    sitk.WriteTransform(transform, path)


def text(path):
    with open(path, "w", encoding="utf-8") as file:
        file.write("no transform\n")


@pytest.mark.parametrize(
    ("name", "write", "told"),
    [
        ("a.tfm", bent, "is not linear; save the linear part alone"),
        ("a.tfm", flat, "is a transform in 2 dimensions; expected 3"),
        ("a.tfm", singular, "its matrix has no inverse"),
        ("a.tfm", text, "is no transform file of ITK; in 3D Slicer, save the linear transform as .tfm or .h5"),
        ("a.h5", text, "is no transform file of ITK"),
        ("a.nii", text, "unknown file type; known types: .tfm, .h5, .txt, .mat"),
        ("a.tfm", lambda path: None, "no such file"),
    ],
)
def test_what_is_no_linear_transform_is_one_line(tmp_path, capfd, name, write, told):
    write(str(tmp_path / name))
    with pytest.raises(InputError) as error:
        read_transform(tmp_path / "case.yaml", name)
    assert told in str(error.value) and "\n" not in str(error.value)
    assert str(error.value).startswith(f"{tmp_path / 'case.yaml'}: perfusion.transform = '{name}': ")
    assert capfd.readouterr() == ("", "")


def test_a_map_is_placed_in_one_way_only(tmp_path):
    both = "{file: lv.vtu, unit: mL/min/g, length_unit: cm, transform: a.tfm, registration: {fixed: ct.nii}}"
    path = write_case(tmp_path, small_tree(), perfusion=both)
    assert "perfusion: give only one of affine, transform and registration" in check_case(path)[0][0]
