"""What pydantic finds wrong with a value, in the words of the user who wrote it."""

import re
from collections.abc import Mapping
from typing import Any

WORDS: dict[str, str] = {
    "missing": "required field is missing",
    "float_type": "expected a number",
    "int_type": "expected a whole number",
    "int_from_float": "expected a whole number",
    "finite_number": "expected a finite number",
    "string_type": "expected text",
    "bool_type": "expected true or false",
    "bool_parsing": "expected true or false",
    "list_type": "expected a list, such as [a, b]",
    "tuple_type": "expected a list, such as [a, b]",
    "dict_type": "expected fields, such as {name: value}",
    "model_type": "expected fields, such as {name: value}",
    "model_attributes_type": "expected fields, such as {name: value}",
}
"""Kind of fault of pydantic → what was expected."""
CHARACTERS = {"A-Z": "letters", "a-z": "letters", "0-9": "digits", " ": "blanks"}


def in_plain_words(fault: Mapping[str, Any]) -> str:
    """Return what is wrong with a value, and what to write, of one of pydantic's errors."""
    kind, value = fault["type"], fault.get("input")
    if value is None and kind.endswith("_type"):
        return "is empty; give a value, or leave the field out"
    if kind in WORDS:
        return WORDS[kind]
    if kind in ("float_parsing", "int_parsing"):
        return ("expected a number" if kind == "float_parsing" else "expected a whole number") + _hint(value)
    if kind == "string_pattern_mismatch":
        return _pattern(fault["ctx"]["pattern"])
    if kind in ("too_short", "too_long"):
        least, most = fault["ctx"].get("min_length"), fault["ctx"].get("max_length")
        wanted = f"at least {least}" if kind == "too_short" else f"at most {most}"
        return f"expected {wanted} of them, not {fault['ctx']['actual_length']}"
    message = str(fault["msg"]).removeprefix("Value error, ")
    return message[:1].lower() + message[1:]


def _hint(value: Any) -> str:
    if re.fullmatch(r"\s*[-+]?\d*,\d+\s*", str(value)):
        return f"; write {str(value).strip().replace(',', '.')}, with a decimal point"
    if number := re.match(r"\s*([-+]?[\d.]+)\s*[^\W\d]|\s*([-+]?[\d.]+)\s*%", str(value)):
        return f"; write {number[1] or number[2]} alone, in the unit of the documentation"
    return ""


def _pattern(pattern: str) -> str:
    """Return in words a pattern such as `^[A-Za-z][A-Za-z0-9_]{0,15}$`: its first and its other characters."""
    found = re.fullmatch(r"\^\[([^]]*)\]\[([^]]*)\]\{0,(\d+)\}\$", pattern)
    if found is None:
        return f"expected text of the form {pattern}"
    first, others = (_characters(part) for part in found.groups()[:2])
    one = first.replace("letters", "a letter").replace("digits", "a digit").replace(" and ", " or ")
    return f"expected {one}, then {others}; at most {1 + int(found[3])} characters"


def _characters(part: str) -> str:
    """Return in words the characters of a set such as `A-Za-z0-9_.-`."""
    names: dict[str, None] = {}
    while part:
        span = part[:3] if len(part) > 2 and part[1] == "-" else part[0]
        names[CHARACTERS.get(span, span)] = None
        part = part[len(span) :]
    *start, last = names
    return f"{', '.join(start)} and {last}" if start else last
