"""A stage run by hand, outside a campaign: its settings from JSON; wrong input is one line and an exit code."""

import sys
from collections.abc import Callable
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from coronaryuq.core.errors import InputError, refusal

Settings = TypeVar("Settings", bound=BaseModel)


def run(work: Callable[[Settings], object], model: type[Settings], settings: str) -> int:
    """Exit code of work(settings), with settings a JSON object that `model` reads."""
    try:
        work(_read(model, settings))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return InputError.EXIT_CODE
    except OSError as error:
        if refusal(error) is None:
            raise
        print(f"error: {refusal(error)}", file=sys.stderr)
        return InputError.EXIT_CODE
    return 0


def _read(model: type[Settings], settings: str) -> Settings:
    try:
        return model.model_validate_json(settings)
    except ValidationError as errors:
        first = errors.errors(include_url=False)[0]
        field = ".".join(map(str, first["loc"])) or None
        raise InputError("--settings", field, first["input"], first["msg"][0].lower() + first["msg"][1:]) from None
