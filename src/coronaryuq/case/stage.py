"""The case stage: `case.yaml` and its files → case.json, tree.vtp, network.json, lv.vtu."""

from pathlib import Path

from coronaryuq.case.anatomy.tree import write_tree
from coronaryuq.case.assembly import assemble
from coronaryuq.case.settings import Settings, Uncertainty
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.vtk import write_vtk
from coronaryuq.core.provenance import stamp


def prepare_case(
    case_yaml: str | Path, settings: Settings, out_dir: str | Path, uncertainty: Uncertainty = "paper"
) -> None:
    """Check a case and write its four files; nothing is written if the case has a fault.

    Parameters
    ----------
    case_yaml : str or Path
        The case's description.
    settings : Settings
        Settings of the case stage.
    out_dir : str or Path
        Folder of case.json, tree.vtp, network.json and lv.vtu.
    uncertainty : "full" or "paper"
        See `assemble`.

    Raises
    ------
    InputError
        At the first fault.
    """
    case = assemble(case_yaml, settings, uncertainty)
    out = Path(out_dir)
    provenance = stamp(case=Path(case_yaml).as_posix(), settings=settings.model_dump())
    write_tree(out / "tree.vtp", case.tree)
    write_json(out / "network.json", case.network)
    write_vtk(out / "lv.vtu", case.wall.mesh)
    write_json(out / "case.json", case.summary.model_dump() | {"provenance": provenance})
