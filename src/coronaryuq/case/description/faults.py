"""A mistake in `case.yaml` as one line: field, value, and what to write instead."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError

from coronaryuq.core.errors import InputError, nearest
from coronaryuq.core.plain_faults import in_plain_words

OTHER_UNITS: dict[str, dict[str, Callable[[float], float]]] = {
    "period": {"in ms": lambda x: x / 1000, "a heart rate per min": lambda x: 60 / x},
    "density": {"in kg/m3": lambda x: x / 1000},
    "tissue_density": {"in kg/m3": lambda x: x / 1000},
    "viscosity": {"in cP or mPa s": lambda x: x / 100, "in Pa s": lambda x: 10 * x},
    "haematocrit": {"in %": lambda x: x / 100},
    "hyperaemia": {"the factor by which flow rises": lambda x: 1 / x},
    "ffr_at.measured": {"in %": lambda x: x / 100},
    "ffr_at.sd": {"in %": lambda x: x / 100},
}
"""Other usual units of a field (blocks before it, without numbers of entries), and the conversion from them."""


def one_line(path: str | Path, errors: ValidationError, model: type[BaseModel]) -> InputError:
    """Return the first mistake that pydantic found in a file as an InputError; it names the others' fields.

    Parameters
    ----------
    path
        The file.
    errors
        What pydantic found.
    model
        The model against which the file was checked.
    """
    # pydantic reports an error for every type of a union: keep only those of the type that the user chose.
    faults = errors.errors(include_url=False)
    faults = [e for e in faults if not ("literal['auto']" in e["loc"] and isinstance(e["input"], list))] or faults
    faults.sort(key=lambda fault: fault["type"] != "extra_forbidden")  # a misspelt field is often a missing one, too
    first = faults[0]
    where = [str(part) for part in first["loc"] if not str(part).startswith(("literal[", "list[", "function-"))]
    field = ".".join(where) or None
    value = None if first["type"] in ("missing", "value_error") else first["input"]
    message = in_plain_words(first)
    if "literal['auto']" in first["loc"]:
        message = "expected auto, a list such as [{name: LAD, vessel: LAD, start: 2.0, end: 3.0}], or [] for none"
        faults = [fault for fault in faults if fault["loc"][:1] != first["loc"][:1]]
        faults.insert(0, first)
    if first["type"] == "extra_forbidden":
        fields = _model_at(model, where[:-1]).model_fields
        message = f"unknown field; {nearest(where[-1], fields)}known fields: {', '.join(fields)}"
        if where[-1].isdigit():  # {start: 1,0} is {start: 1, 0: null}
            message = "a decimal comma? write a decimal point"
    elif first["type"].startswith(("greater_than", "less_than")):
        message += _in_other_units(model, where, value)
    others = ", ".join(dict.fromkeys(".".join(map(str, error["loc"])) or "the whole file" for error in faults[1:]))
    return InputError(path, field, value, message + (f" (also: {others})" if others else ""))


def _in_other_units(model: type[BaseModel], where: Sequence[str], value: Any) -> str:
    """Return what a number out of range would be, were it in another usual unit, for a remedy."""
    field = ".".join(part for part in where if not part.isdigit())
    for unit, convert in OTHER_UNITS.get(field, {}).items():
        info = _model_at(model, where[:-1]).model_fields[where[-1]]
        try:
            converted = convert(float(value))
            kind: Any = Annotated[info.annotation, *info.metadata]
            TypeAdapter(kind).validate_python(converted)
        except (ValidationError, ZeroDivisionError):
            continue
        return f"; if {value} is {unit}, write {converted:g}"
    return ""


def _model_at(model: type[BaseModel], where: Sequence[str]) -> type[BaseModel]:
    """Return the model of a block inside `model`; numbers of a list's entries are passed over."""
    for part in where:
        if part in model.model_fields:
            model = next(_models(model.model_fields[part].annotation), model)
    return model


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models in a type, such as that of an optional list of them."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inside in get_args(annotation):
        yield from _models(inside)
