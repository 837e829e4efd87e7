"""The documentation names files, tests, effects and answers that exist."""

import argparse
import ast
import re
from pathlib import Path

import pytest

from coronaryuq.cli.main import _parser as command_line_parser
from coronaryuq.discrepancy.result import phrases, summary_text
from coronaryuq.zerod.effects.library import LIBRARY, SEARCHED
from coronaryuq.zerod.effects.names import EFFECTS

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "config" / "README.md"])
IN_REPOSITORY = re.compile(r"`((?:tests|benchmarks|docs|config|workflow|envs|src)/[\w./-]+)(?:::(\w+)(\.\.\.)?)?`")
TEST_OF_WORKFLOW = re.compile(r"`(test_\w+)(?:::(test_\w+)(\.\.\.)?)?`")
COMMAND_LINE = re.compile(r"(?:^ {4,}(?:\$ )?|`)coronaryuq ([a-z][^`\n]*)", re.MULTILINE)
PLACEHOLDERS = ("NAME", "MODULE", "K.jsonl")


def unnamed(page):
    """Return the paths and test names of a page that do not exist."""
    text, missing = page.read_text(encoding="utf-8"), []
    for path, test, _ in IN_REPOSITORY.findall(text):
        found = ROOT / path
        if (
            not any(part in path for part in PLACEHOLDERS)
            and not found.exists()
            and not found.with_suffix(".py").exists()
        ):
            missing.append(path)
        if test and found.exists() and f"def {test}" not in found.read_text(encoding="utf-8"):
            missing.append(f"{path}::{test}")
    for module, test, _ in TEST_OF_WORKFLOW.findall(text):
        path = ROOT / "tests" / "workflow" / f"{module}.py"
        if not path.exists() or f"def {test}" not in path.read_text(encoding="utf-8"):
            missing.append(f"{module}::{test}")
    return missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_path_and_test_named_in_the_documentation_exists(page):
    assert unnamed(page) == []


def test_a_path_that_does_not_exist_is_found(tmp_path):
    (tmp_path / "page.md").write_text("`tests/no_such_folder/test_it.py` and `test_slurm::test_no_such_test`")
    assert unnamed(tmp_path / "page.md") == ["tests/no_such_folder/test_it.py", "test_slurm::test_no_such_test"]


def unknown_in_commands(text, parser):
    """Return the commands and options of `coronaryuq` in a text that the parser does not have."""
    unknown = []
    for line in COMMAND_LINE.findall(text):
        command, path = parser, ["coronaryuq"]
        for word in line.partition(" #")[0].partition(" -- ")[0].split():
            subcommands = [action.choices for action in command._actions if action.nargs == argparse.PARSER]
            if word.startswith("--"):
                unknown += [" ".join([*path, word])] * (word.partition("=")[0] not in command._option_string_actions)
            elif subcommands and word in subcommands[0]:
                command, path = subcommands[0][word], [*path, word]
            elif subcommands and word.islower():
                unknown.append(" ".join([*path, word]))
                break
    return unknown


@pytest.fixture(scope="module")
def parser():
    return command_line_parser([], whole=True)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_in_the_documentation_exists(page, parser):
    assert unknown_in_commands(page.read_text(encoding="utf-8"), parser) == []


def test_a_command_that_does_not_exist_is_found(parser):
    text = (
        "`coronaryuq calibrate` and\n\n    coronaryuq bench flow --json\n    coronaryuq tune A B --outt DIR  # tunes\n"
    )
    assert unknown_in_commands(text, parser) == [
        "coronaryuq calibrate",
        "coronaryuq bench flow",
        "coronaryuq tune --outt",
    ]


def test_the_list_of_names_is_that_of_the_library():
    assert tuple(effect.name for effect in SEARCHED) == EFFECTS


def test_the_library_table_has_a_row_for_every_effect():
    page = (ROOT / "docs" / "how-to" / "discrepancy.md").read_text(encoding="utf-8").partition("## The library")[2]
    rows = [line.split("|")[1].strip() for line in page.splitlines() if line.startswith("| ")][1:]
    listed = [name for row in rows for name in row.split(", ")]
    assert sorted(listed) == sorted(effect.name.replace("_", " ") for effect in LIBRARY)


def test_sentences_quoted_in_the_documentation_are_printed_by_the_search():
    """Their words are those of the summary; numbers, places and effects differ from case to case."""
    page = (
        (ROOT / "docs" / "how-to" / "discrepancy.md").read_text(encoding="utf-8").partition("## Reading the answer")[2]
    )
    quoted = [line.split("|")[1].strip() for line in page.partition("## Measurements")[0].splitlines() if "|" in line]
    modules = (phrases, summary_text)
    tree = ast.parse("".join(Path(module.__file__).read_text(encoding="utf-8") for module in modules))
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    docstrings = [ast.get_docstring(node, clean=False) for node in functions]
    constants = [
        node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    printed = " ".join([text for text in constants if text not in docstrings] + list(EFFECTS)).replace("_", " ")
    sentences = [line for line in quoted if line not in ("sentence", "---", "")]
    assert len(sentences) > 10
    for sentence in sentences:
        words = re.sub(r"\([^)]*\)|\b\w*\d[\w:.-]*|under \w+|resistance of \w+", " ", sentence)
        unknown = (
            set(re.findall(r"[A-Za-z]+(?:-[A-Za-z]+)*", words))
            - set(re.findall(r"[A-Za-z]+(?:-[A-Za-z]+)*", printed))
            - {"flow"}
        )
        assert not unknown, sentence
