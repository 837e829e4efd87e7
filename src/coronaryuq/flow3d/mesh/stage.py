"""The mesh rule: a case and its settings in, `mesh-complete.zip`, `mesh-complete/` and `mesh.json` out."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from coronaryuq.case.anatomy.stenosis_detection import example_stenosis
from coronaryuq.case.anatomy.surface import read_surface
from coronaryuq.case.anatomy.tree import Stenosis, Tree, placed_stenoses, read_tree
from coronaryuq.case.case_json import read_case
from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.units import LENGTHS
from coronaryuq.flow3d.mesh import imported_lumen
from coronaryuq.flow3d.mesh.description import MeshDescription
from coronaryuq.flow3d.mesh.generation import folder
from coronaryuq.flow3d.mesh.generation.build import build
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.make_description import describe
from coronaryuq.flow3d.mesh.settings import Settings
from coronaryuq.zerod.network.read import read_network


def make_mesh(
    case: Path, tree: Path, network: Path, settings: Settings, out_dir: Path, lumen: Path | None = None
) -> MeshDescription:
    """Mesh a case into the folder `out_dir`.

    `mesh.json` is written last, so that its presence means a complete mesh.

    Parameters
    ----------
    case, tree, network
        `case.json`, `tree.vtp`, and the 0D network as svZeroDSolver JSON.
    settings
        Domain, resolution, limits.
    out_dir
        Receives `mesh-complete.zip`, `mesh-complete/` and `mesh.json`.
    lumen
        For domain `lumen`: the case's closed surface or mesh-complete folder, in the case's length unit.

    Returns
    -------
    MeshDescription
        Content of `mesh.json`.

    Raises
    ------
    InputError
        The anatomy cannot be meshed; the message says what went wrong at every attempt.
    """
    try:
        return _make_mesh(case, tree, network, settings, out_dir, lumen)
    except MeshError as error:
        remedy = "inspect the geometry there or change mesh.domain or mesh.resolution"
        raise InputError(lumen or tree, None, None, f"{error}; {remedy}") from None


def _make_mesh(
    case: Path, tree: Path, network: Path, settings: Settings, out: Path, lumen: Path | None
) -> MeshDescription:
    content = read_case(case)
    if content.anatomy is None:
        raise InputError(
            case,
            "anatomy",
            None,
            "the case is a schematic 0D network; give centrelines, a surface or a mesh",
        )
    stenoses, whole = placed_stenoses(content.stenoses), read_tree(tree)
    unplaced = [stenosis.name for stenosis in content.stenoses if stenosis.start is None]
    if unplaced:
        remedy = "known only as 0D blocks; give vessel, start and end, or a point, in case.yaml"
        raise InputError(case, "stenoses", unplaced, remedy)
    if not stenoses:
        # Refused here rather than after all runs, when there is nothing to estimate.
        remedy = (
            "no stenosis or segment selected, so no 3D model; run the target `posterior`, or add a segment under "
            f"`stenoses`, such as stenoses: [{example_stenosis(whole)}]"
        )
        raise InputError(case, "stenoses", [], remedy)
    loop = read_network(network)
    if settings.domain != "lumen":
        return mesh_tree(whole, stenoses, loop, settings, out)
    if lumen is None:
        raise InputError(
            case, "anatomy", None, "domain `lumen` needs a surface or a mesh-complete folder; choose `trees`"
        )
    scale = LENGTHS[content.anatomy.unit]
    if lumen.is_dir():
        mesh, description = imported_lumen.adopt_folder(lumen, whole, stenoses, loop, settings, scale)
    else:
        surface = read_surface(lumen, scale)
        mesh, description = imported_lumen.mesh_closed_surface(surface, whole, stenoses, loop, settings, lumen)
    write_mesh(out, mesh, description)
    return description


def mesh_tree(
    tree: Tree, stenoses: Sequence[Stenosis], network: Network, settings: Settings, out: Path
) -> MeshDescription:
    """Mesh a centreline tree into the folder `out`; as `make_mesh`, from objects."""
    built = build(tree, stenoses, settings)
    mesh, description = describe(tree, stenoses, network, built, settings, settings.domain)
    write_mesh(out, mesh, description)
    return description


def write_mesh(out: Path, mesh: folder.Mesh, description: MeshDescription) -> None:
    """Write a mesh and its description into `out`, in place of what was there."""
    out = Path(out)
    (out / "mesh.json").unlink(missing_ok=True)
    shutil.rmtree(out / "mesh-complete", ignore_errors=True)
    folder.write(out / "mesh-complete", mesh)
    folder.pack(out / "mesh-complete", out / "mesh-complete.zip")
    write_json(out / "mesh.json", description.content())
