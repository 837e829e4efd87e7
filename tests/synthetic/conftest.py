"""The bundled patient, made once."""

import pytest

from coronaryuq.synthetic.settings import Settings
from coronaryuq.synthetic.truth import make_patient

SEED = 2024


@pytest.fixture(scope="session")
def patient():
    return make_patient(Settings(cells=8000), SEED)
