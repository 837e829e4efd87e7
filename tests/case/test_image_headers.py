"""An image says where it lies and what it shows, or it is refused in one line."""

import numpy as np
import pytest

from coronaryuq.case.case_json import CaseOutlet
from coronaryuq.case.description.fields import Perfusion
from coronaryuq.case.perfusion.perfusion_map import read_wall
from coronaryuq.case.perfusion.place import check_place
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import TISSUE_DENSITY
from support.images import ORIGIN, SIDE, SPACING, meta_image, nifti, nrrd, shell

pytest.importorskip("SimpleITK")

WRITERS = {"map.nii": nifti, "map.nii.gz": nifti, "map.nrrd": nrrd, "map.mha": meta_image}
UNPLACED = {
    "map.nii": {"codes": (0, 0)}, "map.nii.gz": {"codes": (0, 0)}, "map.nrrd": {"space": None},
    "map.mha": {"offset": False},
}  # fmt: skip
IDENTITY = [[0.1, 0, 0, 0], [0, 0.1, 0, 0], [0, 0, 0.1, 0], [0, 0, 0, 1]]


def read(folder, name, **more):
    given = {"file": name, "unit": "mL/min/g", "length_unit": "mm"} | more
    return read_wall(folder / "case.yaml", Perfusion(**given), TISSUE_DENSITY, 10**6)


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_wall_at_the_same_place(tmp_path, name):
    WRITERS[name](tmp_path / name, shell())
    wall = read(tmp_path, name)
    centre = np.asarray(wall.mesh.center)
    assert np.allclose(centre, (ORIGIN + (SIDE - 1) * SPACING / 2) / 10, atol=1e-5)
    assert wall.volume == pytest.approx((shell() > 0).sum() * (SPACING / 10) ** 3, rel=1e-6) and wall.notes == ()


@pytest.mark.parametrize("options", [{"order": ">"}, {"codes": (1, 0)}, {"codes": (1, 1)}, {"unit": 0}])
def test_sound_headers_are_read(tmp_path, options):
    nifti(tmp_path / "map.nii", shell(), **options)
    assert np.allclose(read(tmp_path, "map.nii").mesh.center, (ORIGIN + (SIDE - 1) * SPACING / 2) / 10, atol=1e-5)


@pytest.mark.parametrize("name", WRITERS)
def test_an_image_without_position_is_refused_unless_the_case_places_it(tmp_path, name):
    WRITERS[name](tmp_path / name, shell(), **UNPLACED[name])
    with pytest.raises(InputError, match=f"{name}: position: the header does not say where the image lies"):
        read(tmp_path, name)
    assert read(tmp_path, name, affine=IDENTITY).volume > 0


@pytest.mark.parametrize("space", ["scanner-xyz", "3D-right-handed", "3D-left-handed", "3D-right-handed-time"])
def test_a_space_that_does_not_say_which_way_is_left_is_no_position(tmp_path, space):
    nrrd(tmp_path / "map.nrrd", shell(), space=space)
    with pytest.raises(InputError, match="map.nrrd: position: the header does not say where the image lies"):
        read(tmp_path, "map.nrrd")


@pytest.mark.parametrize(
    ("name", "voxel", "told"),
    [
        ("map.nii", 0.0, "voxel size = '0 x 5 x 5 and 5 x 5 x 5': expected three positive lengths in the header"),
        ("map.nii", -5.0, "voxel size = '-5 x 5 x 5 and 5 x 5 x 5': expected three positive"),
        ("map.nii", np.nan, "voxel size = 'nan x 5 x 5 and 5 x 5 x 5': expected three positive"),
        ("map.nii", 0.5, "voxel size = '0.5 x 5 x 5 and 5 x 5 x 5': the header's own statements differ"),
        ("map.mha", None, "voxel size: expected three positive lengths in the header"),
        ("map.mha", 0.0, "voxel size = '0 x 5 x 5': expected three positive lengths in the header"),
    ],
)
def test_a_header_without_the_size_of_its_voxels_is_refused(tmp_path, capfd, name, voxel, told):
    WRITERS[name](tmp_path / name, shell(), voxel=voxel)
    with pytest.raises(InputError) as error:
        read(tmp_path, name)
    assert told in str(error.value) and capfd.readouterr() == ("", "")


def test_complex_numbers_are_refused(tmp_path):
    sitk = pytest.importorskip("SimpleITK")
    sitk.WriteImage(sitk.GetImageFromArray(shell().astype(np.complex64)), str(tmp_path / "map.nii"))
    with pytest.raises(InputError, match="map.nii: values: are complex numbers; export their magnitude"):
        read(tmp_path, "map.nii", affine=IDENTITY)


def test_a_folder_of_dicom_files_is_told_how_to_convert(tmp_path):
    (tmp_path / "series").mkdir()
    with pytest.raises(InputError, match="series: is a folder; name a file .DICOM: convert"):
        read(tmp_path, "series")


def test_a_mask_is_not_taken_for_a_map_without_a_word(tmp_path):
    nifti(tmp_path / "map.nii", shell() / 2.0)
    assert read(tmp_path, "map.nii").notes == ("map.nii: every value is 1: is it a mask, and not a map of flow?",)


def test_a_label_that_the_image_lacks_is_told(tmp_path):
    nifti(tmp_path / "map.nii", shell())
    nifti(tmp_path / "lv.nii", np.where(shell() > 0, 4, 0))
    wall = read(tmp_path, "map.nii", label={"file": "lv.nii", "values": [4, 7]})
    assert wall.notes == ("lv.nii: has no label 7 (perfusion.label.values)",)
    with pytest.raises(InputError, match=r"perfusion.label.values = \[1\]: selects no cell: lv.nii has 0, 4"):
        read(tmp_path, "map.nii", label={"file": "lv.nii", "values": [1]})


def test_an_affine_that_mirrors_is_noted(tmp_path):
    nifti(tmp_path / "map.nii", shell())
    mirrored = [[-0.1, 0, 0, 0], *IDENTITY[1:]]
    assert read(tmp_path, "map.nii", affine=mirrored).notes == ("perfusion.affine mirrors the map: check its signs",)
    assert read(tmp_path, "map.nii", affine=IDENTITY).notes == ()


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("skew", [0.05, 0.9])
def test_skewed_axes_are_refused_with_the_remedy(tmp_path, capfd, name, skew):
    WRITERS[name](tmp_path / name, shell(), skew=skew)
    with pytest.raises(InputError, match="axes are not at right angles.*resample"):
        read(tmp_path, name)
    assert capfd.readouterr() == ("", "")


def test_a_sound_qform_does_not_hide_a_skewed_sform(tmp_path, capfd):
    nifti(tmp_path / "map.nii", shell(), codes=(1, 1), skew=0.9)
    with pytest.raises(InputError, match="axes are not at right angles.*resample"):
        read(tmp_path, "map.nii")
    assert capfd.readouterr() == ("", "")


def test_two_positions_that_differ_are_told(tmp_path):
    nifti(tmp_path / "map.nii", shell(), codes=(1, 1), qform_shift=10.0)
    (note,) = read(tmp_path, "map.nii").notes
    assert "its two positions (sform, qform) are up to 10 apart" in note


@pytest.mark.parametrize(
    ("name", "options"), [("map.nii", {"frames": 2}), ("map.nrrd", {"layers": 2}), ("map.mha", {"channels": 2})]
)
def test_several_values_per_voxel_are_refused(tmp_path, name, options):
    WRITERS[name](tmp_path / name, shell(), **options)
    with pytest.raises(InputError, match="= 2: values per voxel.*export a single layer"):
        read(tmp_path, name)


def test_a_label_of_two_layers_is_refused(tmp_path):
    nrrd(tmp_path / "map.nrrd", shell())
    nrrd(tmp_path / "lv.seg.nrrd", (shell() > 0).astype(float), layers=2)
    with pytest.raises(InputError, match=r"lv\.seg\.nrrd: header = 2: values per voxel"):
        read(tmp_path, "map.nrrd", label={"file": "lv.seg.nrrd", "values": [1]})


@pytest.mark.parametrize("length_unit", ["cm", "m"])
def test_the_headers_unit_counts(tmp_path, length_unit):
    nifti(tmp_path / "map.nii", shell())
    with pytest.raises(InputError, match=rf"perfusion\.length_unit = '{length_unit}': the header of map\.nii says mm"):
        read(tmp_path, "map.nii", length_unit=length_unit)


@pytest.mark.parametrize(("unit", "stated"), [(1, "m"), (3, "um")])
def test_a_map_whose_header_is_in_other_units_is_told_what_to_write(tmp_path, unit, stated):
    """The header was said to state mm, which it does not."""
    nifti(tmp_path / "map.nii", shell(), unit=unit)
    told = f"map.nii is read in mm, converted from its header's {stated}; write mm"
    with pytest.raises(InputError, match=told):
        read(tmp_path, "map.nii", length_unit="m")


@pytest.mark.parametrize("name", WRITERS)
def test_a_faint_background_is_not_the_wall(tmp_path, name):
    WRITERS[name](tmp_path / name, np.where(shell() > 0, shell(), 0.001))
    with pytest.raises(InputError, match=r"perfusion\.threshold: \d+ % of the map is below 0\.2 mL/min/g.*give.*label"):
        read(tmp_path, name)
    whole = read(tmp_path, name, threshold=1.0)
    assert whole.volume == pytest.approx((shell() > 0).sum() * (SPACING / 10) ** 3, rel=1e-6)


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("content", [b"", b"\0" * 400, b"NRRD0005\ntype: float\n\n", b"ObjectType = Image\n"])
def test_broken_files_are_one_line_without_words_of_itk(tmp_path, capfd, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as error:
        read(tmp_path, name)
    assert "ITK" not in str(error.value) and capfd.readouterr() == ("", "")


@pytest.mark.parametrize("missing", [1, 9, 4000])
@pytest.mark.parametrize("name", WRITERS)
def test_a_truncated_image_is_refused_without_words_of_itk(tmp_path, capfd, name, missing):
    """Readers fill what is missing from a NIfTI file with zeros: a ventricle without its apex."""
    WRITERS[name](tmp_path / name, np.random.default_rng(1).uniform(1, 2, shell().shape).astype(np.float32))
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[:-missing])
    with pytest.raises(InputError, match=f"{name}: damaged.* truncated"):
        read(tmp_path, name)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("written", "called"), [("a.nii", "b.nii.gz"), ("a.nii.gz", "b.nii")])
def test_a_compressed_file_by_the_wrong_name_is_told(tmp_path, written, called):
    nifti(tmp_path / written, shell())
    (tmp_path / written).rename(tmp_path / called)
    with pytest.raises(InputError, match=f"{called}: is (not )?compressed, unlike its name says; rename it"):
        read(tmp_path, called)


def outlets(points):
    common = {"label": "LAD", "bc": "b", "vessel": "v", "block": "v", "perfuses": "LV", "branch": "LAD", "radius": 0.1}
    return [CaseOutlet(name=f"o{k}", point=tuple(point), **common) for k, point in enumerate(points)]


@pytest.mark.parametrize("turned", [False, True])
def test_axes_of_the_wrong_side_are_told_by_where_the_map_lies(tmp_path, turned):
    nrrd(tmp_path / "map.nrrd", shell())
    map_ = Perfusion(file="map.nrrd", unit="mL/min/g", length_unit="mm")
    wall = read(tmp_path, "map.nrrd")
    wall.mesh.points += np.array([6.0, 4.0, 0.0])
    surface = np.asarray(wall.mesh.points)[::500]
    if not turned:
        assert check_place("case.yaml", map_, wall, outlets(surface)) == ()
        return
    with pytest.raises(InputError, match="with x and y reversed it would be 0 cm: one of map and anatomy is in RAS"):
        check_place("case.yaml", map_, wall, outlets(surface * [-1, -1, 1]))
    sure = map_.model_copy(update={"affine": IDENTITY})
    with pytest.raises(InputError, match="check the affine"):
        check_place("case.yaml", sure, wall, outlets(surface * [-1, -1, 1]))
