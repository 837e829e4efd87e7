"""Inputs of the posterior in words."""

from typing import get_args

import pytest

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.case_json import Branch, CaseSummary
from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.lumen.law import lumen_law
from coronaryuq.case.network.parameter_names import UNMEASURED
from coronaryuq.report.input_names import input_names
from support.case_files import case_content
from support.random_trees import random_tree


@pytest.mark.parametrize("seed", range(5))
def test_every_coordinate_of_a_lumen_has_a_name(seed):
    tree, stenoses = random_tree(seed)
    words = input_names(CaseSummary.model_validate(case_content()))
    names = lumen_law(Tree(tree), stenoses, LumenError()).names
    assert {name: words.get(name) for name in names if name not in words} == {}
    assert all("_" not in words[name] for name in names)
    assert words["lumen_common"] == "the lumen of all arteries"


@pytest.mark.parametrize("artery", get_args(Branch))
def test_the_beds_of_every_artery_without_measured_flow_have_a_name(artery):
    words = input_names(CaseSummary.model_validate(case_content()))
    assert words[UNMEASURED + artery] == f"the beds of the {artery} without measured flow"
