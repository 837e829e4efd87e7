"""What the report says of the error of mesh and time step, which no statistical interval holds."""

from pathlib import Path

from coronaryuq.core import provenance
from coronaryuq.core.io.atomic import read_json

EXTREMES = ("tawss_min_", "osi_max_")
COMPARE = "compare them between draws, not with other meshes."


class MeshError:
    """Error of mesh and time step by 3D quantity, from the campaign's mesh study; none where it was not run or is of
    another mesh.

    mesh: mesh.json of the campaign; study: mesh_study.json, or None.
    """

    def __init__(self, mesh: str | Path, study: str | Path | None):
        self.mesh = read_json(mesh)
        self.study = read_json(study) if study else None
        self.of_another_mesh = bool(self.study) and self.study["checksum"] != provenance.checksum(mesh)

    def of(self, column: str) -> str:
        """`mesh ± error` of a quantity whose values converge, `mesh: range` of one whose values do not, with the error
        of the time step behind it; or nothing.
        """
        found = None if self.study is None or self.of_another_mesh else self.study["quantities"].get(column)
        if found is None:
            return ""
        size = f"{found['error']:.2g}"
        mesh = f"mesh ± {size}" if found["converging"] else f"mesh: range {size}"
        return f"{mesh}, time step ± {found['step_error']:.2g}"

    @property
    def sentence(self) -> str:
        settings = self.mesh["settings"]
        said = (
            f"3D ran on {self.mesh['nodes']} nodes with {settings['throat_resolution']:g} elements over the radius of "
            "a throat. "
        )
        if self.study is None or self.of_another_mesh:
            why = "was measured on another mesh" if self.of_another_mesh else "was not measured"
            return said + (
                f"Its error {why}; the target mesh_study measures it. Extremes of wall shear and OSI settle slowly: "
                + COMPARE
            )
        sizes = ", ".join(str(nodes) for nodes in self.study["nodes"])
        return said + (
            f"Its error was measured with {len(self.study['samples'])} of the samples on meshes of {sizes} nodes: "
            "mesh ± is the grid convergence index (Roache 1998) of the mean; where the values on the three meshes do "
            "not settle, their range is given instead, which is what was seen and no bound. Time step ± is twice the "
            "change with half the step. " + self._earned()
        )

    def _earned(self) -> str:
        """What may be said of single numbers on this mesh."""
        found = self.study["quantities"]
        ffr = max(
            (value["error"] + value["step_error"] for name, value in found.items() if name.startswith("ffr_")),
            default=None,
        )
        said = "" if ffr is None else f"On this mesh FFR is good to {ffr:.2g} at the worst stenosis"
        if all(value["converging"] for name, value in found.items() if name.startswith(EXTREMES)):
            return f"{said}." if said else ""
        return f"{said + '; e' if said else 'E'}xtremes of wall shear and OSI have not settled: {COMPARE}"
