"""A table reads the same however it was written, and what cannot be read is named."""

import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coronaryuq.core.errors import InputError
from coronaryuq.core.io import tables
from coronaryuq.core.io.tables import read_csv, read_table_text, write_csv

floats = st.floats(allow_nan=False, allow_infinity=False)


@pytest.mark.parametrize(
    "raw",
    [
        b"name,value\nvan Gogh,1.5\nb,-2\n",
        b"\xef\xbb\xbfname,value\r\nvan Gogh,1.5\r\nb,-2\r\n",
        b"# by hand\nname,value\nvan Gogh,1.5\n# and more\nb,-2\n",
        b"name,value,,\nvan Gogh,1.5,,\nb,-2,,\n",
        b"name;value\nvan Gogh;1,5\nb;-2\n",
        b"name;value\nvan Gogh;1.5\nb;-2\n",
        b"name\tvalue\nvan Gogh\t1.5\nb\t-2\n",
        b"name;value\r\nvan Gogh;1.5\r\n;\r\nb;-2\r\n ; \r\n;\r\n",
        "name,value\nvan Gogh,1.5\nb,-2\n".encode("utf-16"),
        b"sep=;\r\nname;value\r\nvan Gogh;1,5\r\nb;-2\r\n",
    ],
)
def test_a_table_reads_the_same_however_a_spreadsheet_wrote_it(tmp_path, raw):
    (tmp_path / "t.csv").write_bytes(raw)
    frame = read_csv(tmp_path / "t.csv", ("name", "value"))
    assert list(frame.columns) == ["name", "value"]
    assert frame["name"].tolist() == ["van Gogh", "b"] and frame["value"].tolist() == [1.5, -2.0]


def test_a_table_in_windows_western_code_page(tmp_path):
    (tmp_path / "t.csv").write_bytes("name,note\na,3 µm\n".encode("cp1252"))
    assert read_csv(tmp_path / "t.csv")["note"].tolist() == ["3 µm"]


def test_missing_column_is_reported_with_those_present(tmp_path):
    (tmp_path / "t.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="t.csv: c: column missing; the file has a, b"):
        read_csv(tmp_path / "t.csv", columns=("c",))


@given(st.lists(floats, min_size=1, max_size=20))
def test_csv_floats_survive_the_round_trip_to_the_bit(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("table") / "t.csv"
    write_csv(path, pd.DataFrame({"a": values}))
    assert read_csv(path)["a"].tolist() == values


@pytest.mark.parametrize("row", ["1,2,3\n", "1,2,\n", "1,2,3,4\n"])
def test_rows_longer_than_the_heading_are_not_shifted(tmp_path, row):
    (tmp_path / "table.csv").write_text("a,b\n" + row)
    with pytest.raises(InputError, match="line 2: more cells than the heading; check the separators .decimal commas"):
        read_csv(tmp_path / "table.csv")


CHARACTERS = st.characters(exclude_categories=("Cs",), exclude_characters="\0")
"""A zero byte is in no text file."""


@settings(max_examples=60, deadline=None)
@given(
    lines=st.lists(st.text(CHARACTERS, max_size=12), max_size=12),
    sizes=st.lists(st.integers(1, 40), min_size=1), bytes_at_a_time=st.integers(2, 50),
)  # fmt: skip
def test_a_table_is_the_same_in_pieces_of_any_size(tmp_path_factory, lines, sizes, bytes_at_a_time):
    path = tmp_path_factory.mktemp("pieces") / "table.csv"
    path.write_bytes("\r\n".join(lines).encode())
    whole, _ = read_table_text(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tables, "BLOCK", bytes_at_a_time)
        file, parts = tables.TableText(path), []
        while part := file.read(sizes[len(parts) % len(sizes)]):
            assert len(part) <= sizes[len(parts) % len(sizes)]
            parts.append(part)
    assert "".join(parts) == whole


@pytest.mark.parametrize("name", ["001", "1e3", "NA", "null", "yes", "2024-01-01", "nan", "None", "1"])
def test_names_are_never_typed_by_guess(tmp_path, name):
    """A blank in the column must not turn the others into 1.0 either."""
    path = tmp_path / "a.csv"
    path.write_text(f"name,vessel,value\na,{name},1\nb,,2\n")
    frame = read_csv(path)
    assert frame["vessel"][0] == name and frame["vessel"].isna().tolist() == [False, True]
    assert frame["value"].dtype.kind == "i"


@pytest.mark.parametrize("text", ["a,b,a\n1,2,3\n", "a;b; a\n1;2;3\n", '"a","b","a"\n1,2,3\n'])
def test_a_column_twice_is_refused(tmp_path, text):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match=r"a\.csv: a: column given twice; keep one"):
        read_csv(tmp_path / "a.csv")


def test_utf_16_without_its_mark_is_told_in_one_line(tmp_path):
    (tmp_path / "a.csv").write_bytes("a,b\n1,2\n".encode("utf-16-le"))
    with pytest.raises(InputError, match="not a text file; if it is UTF-16"):
        read_csv(tmp_path / "a.csv")


def test_a_spreadsheet_an_empty_file_and_a_folder_are_told(tmp_path):
    for name, content in (("sheet.csv", b"PK\x03\x04" + bytes(100)), ("empty.csv", b""), ("blank.csv", b"\n \n")):
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match="a spreadsheet .*save it as CSV"):
        read_csv(tmp_path / "sheet.csv")
    for name in ("empty.csv", "blank.csv"):
        with pytest.raises(InputError, match=f"{name}: is empty; expected a heading and rows"):
            read_csv(tmp_path / name)
    with pytest.raises(InputError, match="is a folder; name a file"):
        read_csv(tmp_path)


def test_headings_may_be_capitals_and_one_with_a_unit_is_offered(tmp_path):
    (tmp_path / "a.csv").write_text("Name, X ,Flow\na,1,2\n")
    assert list(read_csv(tmp_path / "a.csv", ("name", "flow")).columns) == ["name", "x", "flow"]
    (tmp_path / "a.csv").write_text("name,flow (mL/min)\na,1\n")
    with pytest.raises(InputError, match="flow: column missing; .*rename 'flow .mL/min.' to flow"):
        read_csv(tmp_path / "a.csv", ("name", "flow"))
    (tmp_path / "a.csv").write_text("Name,name,Flow\na,b,2\n")
    with pytest.raises(InputError, match="name = 'Name, name': column given twice"):
        read_csv(tmp_path / "a.csv", ("name", "flow"))


@pytest.mark.parametrize("mark", [";", "\t"])
def test_a_comma_that_may_separate_thousands_is_asked_about(tmp_path, mark):
    path = tmp_path / "flows.csv"
    path.write_text(f"name{mark}flow\nlad{mark}1,092\nlcx{mark}31\n")
    with pytest.raises(InputError, match=r"line 2 = '1,092': a decimal comma, or thousands\? write 1\.092 or 1092"):
        read_csv(path)
    for certain in ("92,5", "0,031", "31,250"):  # the last: all numbers of the column have three decimals
        path.write_text(f"name{mark}flow\nlad{mark}1,092\nlcx{mark}{certain}\n")
        assert list(read_csv(path)["flow"]) == [1.092, float(certain.replace(",", "."))]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("name,flow\nlad,1\n# note\n\nlcx,2,3\n", r"line 5: has 3 cells, but the heading 2; check the separators"),
        ('name,flow\nlad,1\n"lcx,2\n', "line 3: a quotation mark is opened and never closed"),
        ("lad,0.0,0.0,2.1\nlad,1.0,0.0,2.0\n", "line 1 = 'lad, 0.0, 0.0, 2.1': expected a heading with the names of"),
        ("name,flow, Flow\nlad,1,2\n", "flow = 'flow, Flow': column given twice; keep one"),
    ],
)
def test_a_malformed_table_is_told_by_its_line(tmp_path, text, line):
    path = tmp_path / "flows.csv"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_csv(path, ("name", "flow"))
    assert line in str(error.value) and "\n" not in str(error.value)
