"""Shared parts of the command lines: a parser, argument types, work that reads its settings as JSON."""

import argparse
import json
import re
import sys
import textwrap
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NoReturn, TypeVar

from pydantic import BaseModel, ValidationError

from coronaryuq.core.errors import InputError, nearest, os_error_line
from coronaryuq.core.io.text import TwiceError, parse_json
from coronaryuq.core.plain_faults import in_plain_words

Settings = TypeVar("Settings", bound=BaseModel)


class Parser(argparse.ArgumentParser):
    """An argument parser that suggests corrections for misspelt commands and options.

    Attributes
    ----------
    chosen
        Parser of the chosen command, whose options are suggested.
    """

    chosen: argparse.ArgumentParser | None = None

    def error(self, message: str) -> NoReturn:
        choice = re.search(r"invalid choice: '(.*?)' \(choose from (.*)\)", message)
        option = re.search(r"unrecognized arguments: (--[\w-]+)", message)
        near = ""
        if choice:
            near = nearest(choice[1], re.findall(r"[\w-]+", choice[2]))
        elif option:
            near = nearest(option[1], re.findall(r"--[\w-]+", (self.chosen or self).format_help()))
        super().error(f"{message}; {near.strip()}" if near else message)

    def show_examples(self, examples: Sequence[tuple[str, str]]) -> None:
        """Show example commands, each with a comment, below the options; call it after the description is set."""
        self.formatter_class = argparse.RawDescriptionHelpFormatter
        self.description = textwrap.fill(self.description or "", 100)
        lines = [f"  {command}\n      {remark}" for command, remark in examples]
        self.epilog = "\n".join(["examples:" if len(lines) > 1 else "example:", *lines])


def positive_int(text: str) -> int:
    """Return the integer of an argument; an argparse type for counts (1 or more)."""
    return _integer(text, 1)


def non_negative_int(text: str) -> int:
    """Return the integer of an argument; an argparse type for seeds (0 or more)."""
    return _integer(text, 0)


def _integer(text: str, least: int) -> int:
    if not text.isascii() or not text.isdigit() or int(text) < least:
        raise argparse.ArgumentTypeError(f"{text!r} is not an integer of {least} or more")
    return int(text)


def run_with_settings(work: Callable[[Settings], object], model: type[Settings], settings: str) -> int:
    """Run `work` with settings given as JSON; report wrong input on one line of standard error.

    Parameters
    ----------
    work
        Called with the validated settings.
    model
        Pydantic model of the settings.
    settings
        JSON object, as typed after `--settings`.

    Returns
    -------
    int
        Exit code: 0, or `InputError.EXIT_CODE` for wrong input and for a disk that cannot be written.
    """
    try:
        work(_read(model, settings))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return InputError.EXIT_CODE
    except OSError as error:
        line = os_error_line(error)
        if line is None:
            raise
        print(f"error: {line}", file=sys.stderr)
        return InputError.EXIT_CODE
    return 0


def _read(model: type[Settings], settings: str) -> Settings:
    try:
        with suppress(RecursionError, json.JSONDecodeError):  # which pydantic explains
            parse_json(settings)
        return model.model_validate_json(settings)
    except TwiceError as error:
        raise InputError("--settings", error.key, None, "given twice; keep one") from None
    except ValidationError as errors:
        first = errors.errors(include_url=False)[0]
        field = ".".join(map(str, first["loc"])) or None
        raise InputError("--settings", field, first["input"], in_plain_words(first)) from None
