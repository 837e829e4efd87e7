"""Safe and strict reading of small YAML files: no objects, no aliases, no repeated keys, a size limit.

Plain values are those of YAML 1.2, and `yes`, `no`: 010 is ten, 2024-01-01 and 1:30 are text. Of a value that is not
text, its source is kept, because a name may look like a number.
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.text import read_text

LARGEST = 1_000_000
"""Maximum size, bytes."""

Model = TypeVar("Model", bound=BaseModel)


class Sourced(dict):
    """A mapping that keeps, in `source`, the text of its plain values that are not text."""

    source: dict[Any, str]


class SourcedList(list):
    """A list that keeps, in `source`, the text of its plain values that are not text, by index."""

    source: dict[Any, str]


class _Loader(yaml.SafeLoader):
    """Plain YAML values only, by the rules of YAML 1.1, as other programs guess them."""

    def __init__(self, stream: str, path: str | Path):
        super().__init__(stream)
        self.path = path

    def compose_node(self, parent, index):
        if self.check_event(yaml.events.AliasEvent):
            raise yaml.YAMLError(f"line {self.peek_event().start_mark.line + 1}: aliases (*name) are not supported")
        return super().compose_node(parent, index)

    def construct_mapping(self, node, deep=False):
        lines: dict[str, int] = {}
        for key, _ in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.YAMLError(f"line {line}: a key is not text")
            if key.value in lines:
                first = lines[key.value]
                where = f"in line {line}" if line == first else f"in lines {first} and {line}"
                raise InputError(self.path, key.value, None, f"given twice, {where}; keep one")
            lines[key.value] = line
        found = Sourced((key.value, self.construct_object(value, deep=True)) for key, value in node.value)
        found.source = {key.value: value.value for key, value in node.value if _is_typed(value)}
        return found

    def construct_sequence(self, node, deep=False):
        found = SourcedList(self.construct_object(value, deep=True) for value in node.value)
        found.source = {number: value.value for number, value in enumerate(node.value) if _is_typed(value)}
        return found


_Loader.add_constructor("tag:yaml.org,2002:map", _Loader.construct_mapping)
_Loader.add_constructor("tag:yaml.org,2002:seq", _Loader.construct_sequence)


class _Strict(_Loader):
    """The same with the plain values of YAML 1.2's core schema, and `yes`, `no`, `on` and `off`."""

    yaml_implicit_resolvers: dict = {}

    def construct_yaml_int(self, node):
        text = node.value.lower()
        return int(text, 0) if text.startswith(("0o", "0x")) else int(text)


for _kind, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    (
        "bool",
        "|".join(word for w in ("true", "false", "yes", "no", "on", "off") for word in (w, w.title(), w.upper())),
        list("tTfFyYnNoO"),
    ),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", list("-+0123456789")),
    (
        "float",
        r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
):
    _Strict.add_implicit_resolver(f"tag:yaml.org,2002:{_kind}", re.compile(f"^(?:{_pattern})$"), _first)
_Strict.add_constructor("tag:yaml.org,2002:int", _Strict.construct_yaml_int)


def _is_typed(node: yaml.Node) -> bool:
    return isinstance(node, yaml.ScalarNode) and node.tag != "tag:yaml.org,2002:str" and node.style is None


def read_yaml(path: str | Path, wanted: str = "expected a mapping of fields") -> dict[str, Any]:
    """Read a YAML mapping.

    Parameters
    ----------
    path
        The YAML file.
    wanted
        Message of the error if the file does not contain a mapping.

    Raises
    ------
    InputError
        If the file is missing, too large, not valid YAML or not a mapping, or a key is given twice.
    """
    return _read(path, wanted, _Strict)


def as_written(values: Mapping[str, Any], path: str | Path, wanted: str) -> dict[str, Any]:
    """Return values that another program read from a YAML file, but as `read_yaml` reads those that it left alone.

    Raises
    ------
    InputError
        As `read_yaml`.
    """
    return _preferred(values, _read(path, wanted, _Loader), _read(path, wanted, _Strict))


def _preferred(values: Any, guessed: Any, strict: Any) -> Any:
    if values in (guessed, strict):
        return strict
    if not (isinstance(values, Mapping) and isinstance(guessed, Mapping)):
        return values
    found = Sourced(
        (key, _preferred(value, guessed[key], strict[key]) if key in guessed else value)
        for key, value in values.items()
    )
    found.source = {
        key: text for key, text in strict.source.items() if key in values and values[key] in (guessed[key], strict[key])
    }
    return found


def _read(path: str | Path, wanted: str, loader: Callable[..., _Loader]) -> dict[str, Any]:
    try:
        size = Path(path).stat().st_size if Path(path).is_file() else 0
    except OSError as error:
        raise InputError(path, None, None, f"cannot be read ({error.strerror})") from None
    if size > LARGEST:
        raise InputError(path, None, f"{size} bytes", f"more than {LARGEST} bytes; expected a short text file")
    try:
        content = loader(read_text(path), path).get_single_data()
    except yaml.scanner.ScannerError as error:
        where = error.problem_mark
        if where is not None and "'\\t'" in str(error.problem):
            raise InputError(path, f"line {where.line + 1}", None, "has a tab; indent by blanks") from None
        raise _invalid(path, error) from None
    except (yaml.YAMLError, RecursionError) as error:
        raise _invalid(path, error) from None
    except InputError:
        raise
    except ValueError as error:  # a number that Python does not take
        raise InputError(path, None, None, f"not valid YAML ({error})") from None
    if not isinstance(content, dict):
        raise InputError(path, None, None, wanted)
    return content


def _invalid(path: str | Path, error: Exception) -> InputError:
    """Return a parser's fault by its line, without the parser's account of how it came there."""
    mark = getattr(error, "problem_mark", None)
    if mark is None:
        return InputError(path, None, None, f"not valid YAML ({error})")
    reason = str(getattr(error, "problem", None) or "it cannot be read here")
    hint = {
        "mapping values are not allowed here": "a colon in a text, or a wrong indentation? quote the text",
        "but found another document": "several documents; keep one",
    }.get(reason, reason)
    ahead = read_text(path).splitlines()[mark.line - 1].split("#")[0].strip() if mark.line else ""
    if "mapping values" in reason and ahead and ":" not in ahead and not ahead.startswith("- "):
        hint = "is a colon missing after it? a text of several lines needs quotes"
        return InputError(path, f"line {mark.line}", ahead, f"not valid YAML ({hint})")
    return InputError(path, f"line {mark.line + 1}", None, f"not valid YAML ({hint})")


def texts(values: Any) -> list[Any]:
    """Return the values of a mapping or list; of those that are not text but were written plainly, their source."""
    source = getattr(values, "source", {})
    pairs = values.items() if isinstance(values, dict) else enumerate(values)
    return [source.get(key, value) for key, value in pairs]


def validated(model: type[Model], content: Any) -> Model:
    """Validate what `read_yaml` read; where the model wants text, take a value's source.

    `yes` and `true` are never numbers: pydantic would take them for 1.

    Raises
    ------
    pydantic.ValidationError
        If it does not fit.
    """
    content = _choices_as_written(content)
    while True:
        try:
            return model.model_validate(content)
        except ValidationError as errors:
            faults = [fault["loc"] for fault in errors.errors() if fault["type"] == "string_type"]
            taken = [_take_source(content, where) for where in faults]
            if not any(taken):
                raise


def _choices_as_written(values: Any) -> Any:
    """Replace every true and false by the word in the file, which pydantic takes for a choice, but not for a number."""
    if not isinstance(values, Sourced | SourcedList):
        return values
    pairs = values.items() if isinstance(values, Sourced) else enumerate(values)
    found: Any = Sourced(values) if isinstance(values, Sourced) else SourcedList(values)
    for key, value in pairs:
        found[key] = values.source.get(key, value) if isinstance(value, bool) else _choices_as_written(value)
    found.source = dict(values.source)
    return found


def _take_source(content: Any, where: tuple[int | str, ...]) -> bool:
    """Replace the value at a place of the content by its source; return whether there is one."""
    for step in where:
        source = getattr(content, "source", {})
        if source.get(step):
            content[step] = source.pop(step)
            return True
        # A place also names the members of unions, which are not in the content.
        inside = isinstance(content, dict) and step in content
        if inside or (isinstance(content, list) and step in range(len(content))):
            content = content[step]
    return False
