"""STL files as other programs write them: read, or refused in one line, and VTK says nothing."""

import numpy as np
import pytest

from coronaryuq.case.anatomy.stl import read_stl
from coronaryuq.case.anatomy.surface import SUFFIXES, read_surface
from coronaryuq.core.errors import InputError

CORNERS = np.random.default_rng(1).normal(size=(12, 3, 3)).astype("<f4")


def binary(number=12, header=b"", more=b""):
    records = b"".join(bytes(12) + triangle.tobytes() + bytes(2) for triangle in CORNERS)
    return header.ljust(80, b"\0") + number.to_bytes(4, "little") + records + more


def ascii_text(keywords=str.lower, end="\n"):
    lines = ["solid lumen"]
    for triangle in CORNERS.astype(float):
        lines += ["facet normal 0 0 1", "outer loop", *(f"vertex {x!r} {y!r} {z!r}" for x, y, z in triangle.tolist())]
        lines += ["endloop", "endfacet"]
    return end.join(keywords(line) for line in [*lines, "endsolid lumen", ""]).encode()


@pytest.mark.parametrize(
    "content",
    [
        binary(),
        b"\xef\xbb\xbf" + ascii_text(end="\r\n"),
        binary(header=b"solid by a program that begins so"),
        ascii_text(),
        ascii_text(str.upper),
        ascii_text(end="\r\n"),
        b"\n\n" + ascii_text(),
        ascii_text() + ascii_text(),
    ],
    ids=["binary", "byte-order mark", "binary, solid", "ASCII", "capitals", "Windows", "blank lines", "two solids"],
)
def test_every_form_is_read(tmp_path, content):
    (tmp_path / "a.stl").write_bytes(content)
    corners, notes = read_stl(tmp_path / "a.stl")
    assert np.array_equal(corners[:12], CORNERS) and notes == ()


def test_bytes_behind_the_triangles_are_left_out_with_a_note(tmp_path):
    (tmp_path / "a.stl").write_bytes(binary(more=b"made by somebody"))
    corners, (note,) = read_stl(tmp_path / "a.stl")
    assert np.array_equal(corners, CORNERS) and "a.stl has 16 bytes behind its triangles" in note


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "not an STL file, or an empty one"),
        (b"hello\n" * 30, "truncated|not an STL file"),
        (binary(number=0), "not an STL file, or an empty one"),
        (binary()[:300], "triangles = 4: truncated: the header announces 12"),
        (binary(number=1000), "triangles = 12: truncated: the header announces 1000"),
        (ascii_text().replace(b".", b","), "vertex: expected numbers with a decimal point"),
        (ascii_text()[:-100], "vertex = 3[45]: truncated"),
        (binary().replace(CORNERS[0, 0].tobytes(), np.full(3, np.nan, "<f4").tobytes()), "not a finite number"),
    ],
)
def test_broken_files_are_one_line(tmp_path, capfd, content, told):
    (tmp_path / "a.stl").write_bytes(content)
    with pytest.raises(InputError, match=told):
        read_surface(tmp_path / "a.stl")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", sorted(set(SUFFIXES) - {".stl"}))
@pytest.mark.parametrize("content", [b"", b"\0" * 500, b"<?xml version='1.0'?><VTKFile></VTKFile>", b"ply\nnot\n"])
def test_vtk_says_nothing_of_a_broken_surface(tmp_path, capfd, suffix, content):
    (tmp_path / f"a{suffix}").write_bytes(content)
    with pytest.raises(InputError) as error:
        read_surface(tmp_path / f"a{suffix}")
    assert capfd.readouterr() == ("", "") and "ERROR" not in str(error.value) and "0x" not in str(error.value)
