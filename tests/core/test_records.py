"""Records come back as they were written, and broken ones are named."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.core import records
from coronaryuq.core.errors import InputError

floats = st.floats(allow_nan=False, allow_infinity=False)


@given(value=floats, text=st.text(max_size=20))
def test_records_survive_the_round_trip_to_the_bit(tmp_path_factory, value, text):
    path = tmp_path_factory.mktemp("records") / "batch.jsonl"
    written = [
        records.Record("sample_0000", {"BC_lca1": value}, {"ffr_lad": value}, diagnostics={"note": text}),
        records.Record.failed("sample_0001", {"BC_lca1": value}, "blew up\nat step 3"),
    ]
    records.write(path, written)
    back = records.read(path)
    assert back == written
    assert back[0].ok and not back[1].ok and back[1].reason == "blew up at step 3"
    assert math.copysign(1, back[0].outputs["ffr_lad"]) == math.copysign(1, value)


@pytest.mark.parametrize(
    "text", ["", '{"sample": "a"', '{"sample": "a"}\n', '{"sample": "a", "inputs": {}, "x": 1}\n', "[1]\n"]
)
def test_broken_records_are_reported(tmp_path, text):
    path = tmp_path / "batch_3.jsonl"
    path.write_text(text)
    with pytest.raises(InputError, match="batch_3.jsonl"):
        records.read(path)
