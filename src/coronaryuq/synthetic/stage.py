"""Stage of the bundled patient: settings and a seed → a folder with case.yaml and truth.json."""

from pathlib import Path

from coronaryuq.synthetic.patient import write_files
from coronaryuq.synthetic.settings import Settings
from coronaryuq.synthetic.truth import make_patient


def write_patient(settings: Settings, seed: int, out_dir: str | Path) -> None:
    """Make the patient and write its files, `case.yaml` last, so that it exists only if all others do.

    Parameters
    ----------
    settings : Settings
        Settings of the bundled patient.
    seed : int
        The campaign's seed.
    out_dir : str or Path
        Folder to write to.

    Raises
    ------
    ValueError, RuntimeError
        If the settings contradict one another.
    """
    write_files(make_patient(settings, seed), out_dir)
