"""The bundled patient's stage: settings and a seed → `patient/` with case.yaml and truth.json."""

from pathlib import Path

from coronaryuq.synthetic.patient import write_files
from coronaryuq.synthetic.settings import Settings
from coronaryuq.synthetic.truth import make_patient


def write_patient(settings: Settings, seed: int, out_dir: str | Path) -> None:
    """Make the patient and write its files; `case.yaml` comes last, so that it is there only when all are.

    Raises ValueError or RuntimeError when the settings contradict one another.
    """
    write_files(make_patient(settings, seed), out_dir)
