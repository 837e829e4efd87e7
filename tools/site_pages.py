"""MkDocs hook: add the pages that are made from the code and from files outside docs/, and point links at them."""

import argparse
import os
import re
import sys
from pathlib import Path

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "src"))  # the checkout that the site describes, whatever is installed

from coronaryuq.cli.main import _parser  # noqa: E402

OUTSIDE = {
    "config/README.md": "reference/configuration.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "README.md": "index.md",
}
"""Files outside docs/ → their pages. The README's place is the site's first page, which is a file of docs/."""


def on_files(files, config):
    """Add the generated pages."""
    pages = {page: (ROOT / path).read_text(encoding="utf-8") for path, page in OUTSIDE.items() if page != "index.md"}
    for page, text in {**pages, "reference/cli.md": command_reference()}.items():
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown, page, config, files):
    """Point links that leave docs/, which work in a checkout, at the site's pages."""
    uri = page.file.src_uri
    source = {target: path for path, target in OUTSIDE.items() if target != "index.md"}.get(uri, f"docs/{uri}")
    return re.sub(r"(!?)\[([^]]*)\]\(([^)\s]+)\)", lambda link: _on_site(link, source, uri), markdown)


def _on_site(link: re.Match, source: str, uri: str) -> str:
    """One link as the site needs it; a link to a file that the site does not have becomes its text."""
    image, text, target = link.groups()
    path, hash_, anchor = target.partition("#")
    if not path or re.match(r"[a-z]+:", path):
        return link[0]
    path = os.path.normpath(os.path.join(os.path.dirname(source), path))
    if not (ROOT / path).exists() and path != "docs/reference/cli.md":
        raise PluginError(f"{source}: {target} does not exist")
    path = f"docs/{OUTSIDE[path]}" if path in OUTSIDE else path
    if not path.startswith("docs/"):
        return text
    return f"{image}[{text}]({os.path.relpath(path, os.path.dirname(f'docs/{uri}'))}{hash_}{anchor})"


def command_reference() -> str:
    """Return the reference of the command line, made from its parser."""
    os.environ["COLUMNS"] = "100"
    parser = _parser([], whole=True)
    lines = ["# Command line", "", "Made from the parser; `coronaryuq COMMAND --help` prints the same.", ""]
    return "\n".join([*lines, *_command(parser, 1)])


def _command(parser: argparse.ArgumentParser, level: int) -> list[str]:
    """Heading, usage, arguments and examples of a command, then its subcommands."""
    lines = [f"{'#' * level} `{parser.prog}`", ""] if level > 1 else []
    lines += [parser.description or "", "", "```text", parser.format_usage().strip(), "```", ""]
    commands = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    shown = [action for action in parser._actions if action.dest != "help" and action not in commands]
    if shown:
        lines += ["| argument | meaning |", "|---|---|", *map(_row, shown), ""]
    if parser.epilog:
        lines += ["```text", parser.epilog.strip(), "```", ""]
    for action in commands:
        for command in action.choices.values():
            lines += _command(command, level + 1)
    return lines


def _row(action: argparse.Action) -> str:
    name = action.metavar if isinstance(action.metavar, str) else action.dest
    if action.choices and action.metavar is None:
        name = "{" + ",".join(map(str, action.choices)) + "}"
    words = [f"{option} {name}" if action.nargs != 0 else option for option in action.option_strings] or [name]
    meaning = (action.help or "") % {**vars(action), "prog": ""}
    return f"| {', '.join(f'`{word}`' for word in words)} | {meaning} |".replace("\n", " ")
