"""Results as types: dataclasses that a stage writes to JSON and a reader gets back, checked."""

from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

from coronaryuq.core.errors import InputError
from coronaryuq.core.plain_faults import in_plain_words

Result = TypeVar("Result")


def plain(result: Any) -> Any:
    """Return a dataclass, or a list or dictionary of them, as dictionaries for a JSON file.

    A field that has a default is left out if it is None; one without is written as null.
    """
    if is_dataclass(result):
        values = [(field, getattr(result, field.name)) for field in fields(result)]
        return {field.name: plain(value) for field, value in values if value is not None or field.default is MISSING}
    if isinstance(result, dict):
        return {name: plain(value) for name, value in result.items()}
    return [plain(value) for value in result] if isinstance(result, list) else result


def checked(kind: type[Result], value: Any, path: str | Path, remedy: str = "recreate it") -> Result:
    """Return plain values as `kind`, a dataclass, pydantic model or list of them.

    Raises
    ------
    InputError
        If a field is missing or of another type; it names `path`, the field and the remedy.
    """
    from pydantic import TypeAdapter, ValidationError

    try:
        return TypeAdapter(kind).validate_python(value)
    except ValidationError as errors:
        first = errors.errors(include_url=False)[0]
        field = ".".join(map(str, first["loc"])) or None
        if first["type"] == "missing":
            raise InputError(path, field, None, f"missing; {remedy}") from None
        raise InputError(path, field, first["input"], f"{in_plain_words(first)}; {remedy}") from None
