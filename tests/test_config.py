"""The configuration model, and what is made from it."""

import re
from pathlib import Path

import pytest
import yaml

from coronaryuq import config
from coronaryuq.errors import InputError
from coronaryuq.files import read_json

FOLDER = Path(__file__).parents[1] / "config"


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_configurations_are_valid_and_named_as_their_files(path):
    assert config.load(path).name == path.stem


def test_the_paper_configuration_has_the_papers_size():
    paper = config.load(FOLDER / "paper.yaml")
    assert (paper.samples.n_3d, paper.samples.n_0d, paper.perfusion.realisations) == (500, 10000, 2500)
    assert (paper.posterior.dream.chains, paper.posterior.dream.generations) == (24, 10000)


def test_readme_and_schema_are_those_of_the_model():
    assert (FOLDER / "README.md").read_text() == config.readme(), "run workflow/scripts/config_docs.py"
    assert read_json(FOLDER / "schema.json") == config.schema(), "run workflow/scripts/config_docs.py"


def test_a_default_of_the_readme_may_be_pasted_into_a_configuration(tmp_path):
    """All of them together are the campaign that a name alone gives."""
    pasted: dict = {"name": "pasted"}
    for setting, default in re.findall(r"^\| `([\w.]+)` \| `(.*?)` \| ", config.readme(), re.MULTILINE):
        *blocks, name = setting.split(".")
        place = pasted
        for block in blocks:
            place = place.setdefault(block, {})
        place[name] = yaml.safe_load(default)
    (tmp_path / "pasted.yaml").write_text(yaml.safe_dump(pasted))
    (tmp_path / "plain.yaml").write_text("name: pasted\n")
    assert len(pasted) > 8
    assert config.load(tmp_path / "pasted.yaml") == config.load(tmp_path / "plain.yaml")


def test_every_setting_is_described():
    def check(schema):
        for name, field in schema.get("properties", {}).items():
            assert field.get("description"), name

    whole = config.schema()
    check(whole)
    for part in whole["$defs"].values():
        check(part)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "not a configuration"),
        ("- a\n", "not a configuration"),
        ("name: [", "not valid YAML"),
        ("seed: 1\n", "name: field required"),
        ("name: x\nsamples: {n_3d: 1}\n", "samples.n_3d = 1: input should be greater than or equal to 8"),
        ("name: x\nsamples: {n3d: 100}\n", "samples.n3d = 100: unknown setting; known here: n_3d, n_0d"),
        ("name: x\nposterior: {dream: {chains: 7}}\n", "posterior.dream"),
        ("name: !!python/object/apply:os.system [ls]\n", "not valid YAML"),
    ],
)
def test_mistakes_are_one_line_with_file_field_and_remedy(tmp_path, text, said):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        config.load(path)
    assert str(caught.value).startswith(str(path)) and said in str(caught.value) and "\n" not in str(caught.value)
