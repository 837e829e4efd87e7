"""Settings that contradict one another are rejected."""

import pytest

from coronaryuq.perfusion.settings import Settings


def test_the_model_to_use_must_be_among_the_models():
    with pytest.raises(ValueError, match="not among the models"):
        Settings(use="absent")
    assert Settings().use == "outlet"
