"""The mesh rule: a case and its settings in, `mesh-complete.zip`, `mesh-complete/` and `mesh.json` out."""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from coronaryuq.case.anatomy.stenosis_detection import example
from coronaryuq.case.anatomy.surface import read_surface
from coronaryuq.case.anatomy.tree import Stenosis, Tree, read_tree
from coronaryuq.case.case_json import read_case
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.units import LENGTHS
from coronaryuq.flow3d.mesh import imported_lumen
from coronaryuq.flow3d.mesh.coupling.describe import describe
from coronaryuq.flow3d.mesh.generation import folder, regions
from coronaryuq.flow3d.mesh.generation.build import build
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.settings import Settings
from coronaryuq.zerod.network.read import Network, read_network


def make_mesh(case: Path, tree: Path, network: Path, settings: Settings, out: Path, lumen: Path | None = None) -> dict:
    """Mesh a case (`case.json`, `tree.vtp`, 0D network JSON) into the folder `out`; returns what `mesh.json` holds.

    lumen: for domain `lumen`, the case's closed surface or mesh-complete folder, in the case's length unit.
    `mesh.json` is written last, so that its presence means a complete mesh. Raises InputError when the anatomy cannot
    be meshed, with what went wrong at every attempt.
    """
    try:
        return _make_mesh(case, tree, network, settings, out, lumen)
    except MeshError as error:
        remedy = "see the anatomy there, or choose another mesh.domain or mesh.resolution"
        raise InputError(lumen or tree, None, None, f"{error}; {remedy}") from None


def _make_mesh(case: Path, tree: Path, network: Path, settings: Settings, out: Path, lumen: Path | None) -> dict:
    content = read_json(case)
    if content.get("schematic"):
        raise InputError(case, "anatomy", None, "the case has none, and a drawing of a 0D network is not to be meshed")
    stenoses, whole = read_stenoses(case), read_tree(tree)
    if not stenoses:
        # Refused here rather than when the runs are done and there is no row to estimate.
        remedy = (
            "no vessel to make a 3D model of, so that the campaign ends at its target posterior; name a stretch of an "
            f"artery in case.yaml, narrow or not, such as stenoses: [{example(whole)}]"
        )
        raise InputError(case, "stenoses", [], remedy)
    loop = read_network(network)
    if settings.domain != "lumen":
        return mesh_tree(whole, stenoses, loop, settings, out)
    if lumen is None:
        raise InputError(
            case, "anatomy", None, "domain `lumen` needs a surface or a mesh-complete folder; choose `trees`"
        )
    scale = LENGTHS[content["anatomy"]["unit"]]
    if lumen.is_dir():
        mesh, made = imported_lumen.adopt_folder(lumen, whole, stenoses, loop, settings, scale)
    else:
        surface = read_surface(lumen, scale)
        mesh, made = imported_lumen.mesh_closed_surface(surface, whole, stenoses, loop, settings, lumen)
    write_mesh(out, mesh, made)
    return made


def read_stenoses(case: Path) -> list[Stenosis]:
    """Stenoses of a `case.json`, in its order."""
    found = read_case(case, *(f"stenoses.{name}" for name in ("name", "vessel", "start", "end")))["stenoses"]
    return [Stenosis(s["name"], s["vessel"], float(s["start"]), float(s["end"])) for s in found]


def mesh_tree(tree: Tree, stenoses: Sequence[Stenosis], network: Network, settings: Settings, out: Path) -> dict:
    """As `make_mesh`, from objects."""
    built = build(tree, stenoses, settings)
    present = [s for s in stenoses if s.vessel in built.kept]
    mesh, said = regions.mark(
        tree, present, built, settings.region_upstream_diameters, settings.region_downstream_diameters
    )
    built = replace(built, mesh=mesh)
    planes = {s.name: regions.plane(tree, s, built, settings.ffr_diameters) for s in present}
    content = describe(tree, present, network, built, said, planes, settings)
    write_mesh(out, mesh, content)
    return content


def write_mesh(out: Path, mesh: folder.Mesh, content: dict) -> None:
    """Write a mesh and its description into `out`, in place of what was there."""
    out = Path(out)
    (out / "mesh.json").unlink(missing_ok=True)
    shutil.rmtree(out / "mesh-complete", ignore_errors=True)
    folder.write(out / "mesh-complete", mesh)
    folder.pack(out / "mesh-complete", out / "mesh-complete.zip")
    write_json(out / "mesh.json", content)
