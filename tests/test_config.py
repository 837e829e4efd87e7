"""The configuration model, its documentation, and the errors of wrong configurations."""

import re
from pathlib import Path
from typing import get_args

import pytest
import yaml

from coronaryuq import config
from coronaryuq.core import shipped
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.units import PRESSURES
from coronaryuq.discrepancy.settings import Settings as Discrepancy
from coronaryuq.estimation.settings import Settings as Estimation
from coronaryuq.zerod.effects.library import SEARCHED
from coronaryuq.zerod.network.beds import SCALING

FOLDER = Path(__file__).parents[1] / "config"


@pytest.mark.parametrize("path", sorted(shipped.configurations().values()), ids=lambda path: path.stem)
def test_shipped_configurations_are_valid_and_named_like_their_files(path):
    assert config.load(path).name == path.stem


def test_the_paper_configuration_has_the_sample_counts_of_the_paper():
    paper = config.load(FOLDER / "paper.yaml")
    assert (paper.samples.n_3d, paper.samples.n_0d, paper.perfusion.realisations) == (500, 10000, 2500)
    assert (paper.posterior.dream.chains, paper.posterior.dream.generations) == (24, 10000)


def test_readme_and_schema_are_up_to_date():
    assert (FOLDER / "README.md").read_text() == config.readme(), "run tools/config_docs.py"
    assert read_json(FOLDER / "schema.json") == config.schema(), "run tools/config_docs.py"


def test_defaults_from_the_readme_can_be_pasted_into_a_configuration(tmp_path):
    """All of them together give the same campaign as a name alone."""
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


def test_settings_allow_exactly_the_names_that_the_code_knows():
    """Settings repeat them, because they import nothing."""

    def allowed(model, name):
        kinds = get_args(model.model_fields[name].annotation)
        return [value for kind in kinds for value in get_args(kind) or (kind,) if value is not type(None)]

    assert allowed(Discrepancy, "hidden_effect") == [effect.name for effect in SEARCHED]
    assert allowed(Discrepancy, "pressure_unit") == ["auto", *PRESSURES]
    assert allowed(Estimation, "known_scaling") == [SCALING]


def test_the_readme_lists_the_values_of_a_setting_with_few():
    lines = {line.split("`")[1]: line for line in config.readme().splitlines() if line.startswith("| `")}
    assert "; one of `ensemble`, `svsolver`, `svmultiphysics`, `umbridge`." in lines["backend"]
    assert "; one of `R_cor_scaling`, `null`." in lines["estimation.known_scaling"]
    assert "one of" not in lines["mesh.domain"], "its description explains all of them"


def test_every_setting_is_described():
    def check(schema):
        for name, field in schema.get("properties", {}).items():
            assert field.get("description"), name

    whole = config.schema()
    check(whole)
    for part in whole["$defs"].values():
        check(part)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not a configuration"),
        ("- a\n", "not a configuration"),
        ("name: [", "not valid YAML"),
        ("seed: 1\n", "name: required field is missing"),
        ("name: x\nsamples: {n_3d: 1}\n", "samples.n_3d = 1: input should be greater than or equal to 8"),
        (
            "name: x\nsamples: {n3d: 100}\n",
            "samples.n3d = 100: unknown setting; did you mean n_3d? known here: n_3d, n_0d",
        ),
        ("name: x\nposterior: {dream: {chains: 7}}\n", "posterior.dream"),
        (
            "name: x\nbackend: fluent\n",
            "backend = 'fluent': input should be 'ensemble', 'svsolver', 'svmultiphysics' or 'umbridge'",
        ),
        (
            "name: x\ndiscrepancy: {hidden_effect: gremlin}\n",
            "discrepancy.hidden_effect = 'gremlin': input should be 'quadratic_stenosis', ",
        ),
        (
            "name: x\ndiscrepancy: {pressure_unit: psi}\n",
            "discrepancy.pressure_unit = 'psi': input should be 'auto', 'dyn/cm2', 'mmHg', 'Pa' or 'kPa'",
        ),
        (
            "name: x\nestimation: {known_scaling: foo}\n",
            "estimation.known_scaling = 'foo': input should be 'R_cor_scaling'",
        ),
        ("name: !!python/object/apply:os.system [ls]\n", "not valid YAML"),
    ],
)
def test_mistakes_are_reported_on_one_line_with_file_field_and_remedy(tmp_path, text, message):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        config.load(path)
    assert str(caught.value).startswith(str(path)) and message in str(caught.value) and "\n" not in str(caught.value)
