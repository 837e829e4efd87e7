"""Errors of mesh and time step, which no statistical interval includes, in words for the report."""

from pathlib import Path

from coronaryuq.core import provenance
from coronaryuq.core.io.atomic import read_json

EXTREMES = ("tawss_min_", "osi_max_")
COMPARE = "they are valid only for comparing draws on the same mesh."


class MeshError:
    """Error of mesh and time step of each 3D quantity, if the campaign's mesh study was run on this mesh.

    Parameters
    ----------
    mesh
        mesh.json of the campaign.
    study
        mesh_study.json, or None.
    """

    def __init__(self, mesh: str | Path, study: str | Path | None):
        self.mesh = read_json(mesh)
        self.study = read_json(study) if study else None
        self.of_another_mesh = self.study is not None and self.study["checksum"] != provenance.checksum(mesh)

    def of(self, column: str) -> str:
        """Return `mesh ± error` (`mesh: range` where values do not converge) and the time step's error, or nothing."""
        quantity = self._quantities().get(column)
        if quantity is None:
            return ""
        size = f"{quantity['error']:.2g}"
        mesh = f"mesh ± {size}" if quantity["converging"] else f"mesh: range {size}"
        return f"{mesh}, time step ± {quantity['step_error']:.2g}"

    def _quantities(self) -> dict:
        return {} if self.study is None or self.of_another_mesh else self.study["quantities"]

    @property
    def sentence(self) -> str:
        settings = self.mesh["settings"]
        mesh = (
            f"3D runs used a mesh of {self.mesh['nodes']} nodes with {settings['throat_resolution']:g} elements over "
            "the radius of a throat. "
        )
        if self.study is None or self.of_another_mesh:
            state = "was measured on another mesh" if self.of_another_mesh else "was not measured"
            return mesh + (
                f"Its error {state}; the target mesh_study measures it. Extremes of wall shear and OSI converge "
                "slowly: " + COMPARE
            )
        sizes = ", ".join(str(nodes) for nodes in self.study["nodes"])
        return mesh + (
            f"Its error was measured with {len(self.study['samples'])} of the samples on meshes of {sizes} nodes: "
            "mesh ± is the grid convergence index (Roache 1998) of the mean; if the values on the three meshes do not "
            "converge, their range is given instead, which is not a bound. Time step ± is twice the change at half the "
            "step. " + self._reliability()
        )

    def _reliability(self) -> str:
        """Return the reliability of values on this mesh."""
        quantities = self._quantities()
        ffr = max(
            (value["error"] + value["step_error"] for name, value in quantities.items() if name.startswith("ffr_")),
            default=None,
        )
        accuracy = "" if ffr is None else f"On this mesh FFR is accurate to {ffr:.2g} at the worst stenosis"
        if all(value["converging"] for name, value in quantities.items() if name.startswith(EXTREMES)):
            return f"{accuracy}." if accuracy else ""
        return f"{accuracy + '; e' if accuracy else 'E'}xtremes of wall shear and OSI have not converged: {COMPARE}"
