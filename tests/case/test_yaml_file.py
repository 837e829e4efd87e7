"""YAML is read strictly, by one reader for every door, and names are taken as they are written."""

import pytest
import yaml
from pydantic import BaseModel, ValidationError

from coronaryuq import config
from coronaryuq.campaign.start import read_campaign
from coronaryuq.case.description.yaml_file import as_written, read_yaml, validated
from coronaryuq.core.errors import InputError

NAMES = ["001", "010", "1e3", "1.50", "NA", "null", "yes", "No", "on", "2024-01-01", "12:30", "0x1F", ".5", "true", "~"]


class Model(BaseModel):
    name: str
    several: list[str] = []
    number: float = 0.0
    flag: bool = False


def read(tmp_path, text, **options):
    (tmp_path / "a.yaml").write_bytes(text.encode())
    return read_yaml(tmp_path / "a.yaml", **options)


@pytest.mark.parametrize("name", NAMES)
def test_names_are_what_is_written(tmp_path, name):
    found = validated(Model, read(tmp_path, f"name: {name}\nseveral: [{name}, a]\n"))
    assert found.name == name and found.several == [name, "a"]


@pytest.mark.parametrize(
    ("written", "number"), [("010", 10.0), ("1e3", 1000.0), ("5e-3", 0.005), (".5", 0.5), ("-2", -2.0), ("0x10", 16.0)]
)
def test_numbers_are_what_they_look_like(tmp_path, written, number):
    assert validated(Model, read(tmp_path, f"name: a\nnumber: {written}\n")).number == number


@pytest.mark.parametrize(("written", "value"), [("yes", True), ("off", False), ("true", True)])
def test_yes_and_no_are_taken_where_a_choice_is_asked_for(tmp_path, written, value):
    assert validated(Model, read(tmp_path, f"name: a\nflag: {written}\n")).flag is value


@pytest.mark.parametrize("written", ["yes", "True", "off"])
def test_a_choice_is_no_number(tmp_path, written):
    with pytest.raises(ValidationError, match="number"):
        validated(Model, read(tmp_path, f"name: a\nnumber: {written}\n"))
    assert read(tmp_path, f"name: a\nnumber: {written}\n")["number"] in (True, False)


@pytest.mark.parametrize("key", NAMES)
def test_keys_are_text(tmp_path, key):
    assert list(read(tmp_path, f"{key}: 1\n")) == [key]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a: 1\nb: {c: 1, c: 2}\n", "c: given twice, in line 2; keep one"),
        ("a: 1\r\nb: 2\r\na: 3\r\n", "a: given twice, in lines 1 and 3; keep one"),
        ("1: a\n'1': b\n", "1: given twice, in lines 1 and 2; keep one"),
        ("x:\n- {a: 1, a: 1}\n", "a: given twice, in line 2; keep one"),
    ],
)
def test_a_key_twice_is_named_with_its_lines(tmp_path, text, told):
    with pytest.raises(InputError, match=rf"a\.yaml: {told}$"):
        read(tmp_path, text)


def test_what_another_program_read_is_taken_as_written(tmp_path):
    """Snakemake reads a file itself; what it has from there is ours, what is from elsewhere stays."""
    (tmp_path / "a.yaml").write_text("name: 010\nb: {c: 012, d: 1}\ne: [007]\n")
    theirs = yaml.safe_load((tmp_path / "a.yaml").read_text()) | {"f": 3}
    theirs["b"]["d"] = 2
    found = as_written(theirs, tmp_path / "a.yaml", "")
    assert found == {"name": 10, "b": {"c": 12, "d": 2}, "e": [7], "f": 3}
    assert found.source == {"name": "010"} and found["b"].source == {"c": "012"}


@pytest.mark.parametrize("text", ["name: a\nsamples: {n_3d: 24}\nsamples: {n_3d: 16}\n", "name: a\nname: b\n"])
def test_the_workflow_and_the_commands_refuse_the_same_file(tmp_path, text):
    path = tmp_path / "a.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match="given twice") as ours:
        config.load(path)
    with pytest.raises(InputError, match="given twice") as snakemakes:
        read_campaign(yaml.safe_load(text), [str(path)], path)
    assert str(ours.value) == str(snakemakes.value)


def test_a_campaign_may_be_named_by_a_number(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("name: 007\n")
    assert config.load(path).name == "007"
    assert read_campaign({"name": 7}, [str(path)], path).campaign.name == "007"
