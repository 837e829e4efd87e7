"""A fault that pydantic finds is told in plain words."""

from typing import Annotated

import pytest
from pydantic import BaseModel, Field, ValidationError

from coronaryuq.core.plain_faults import in_plain_words


class Model(BaseModel):
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.-]{0,63}$")] = "a"
    number: float = 0.0
    count: int = 0
    several: list[str] = Field(["a"], min_length=1)
    block: dict[str, float] = {}
    other: Annotated[str, Field(pattern="^a|b$")] = "a"


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("name", "é", "expected a letter or a digit, then letters, digits, blanks, _, . and -; at most 64 characters"),
        ("number", "0,8", "expected a number; write 0.8, with a decimal point"),
        ("number", "0.8 s", "expected a number; write 0.8 alone, in the unit of the documentation"),
        ("number", "fast", "expected a number"),
        ("number", None, "is empty; give a value, or leave the field out"),
        ("count", 1.5, "expected a whole number"),
        ("several", [], "expected at least 1 of them, not 0"),
        ("several", "a", "expected a list, such as [a, b]"),
        ("block", 5, "expected fields, such as {name: value}"),
        ("other", "c", "expected text of the form ^a|b$"),
    ],
)
def test_a_fault_is_told_in_plain_words(field, value, told):
    with pytest.raises(ValidationError) as caught:
        Model.model_validate({field: value})
    assert in_plain_words(caught.value.errors()[0]) == told
