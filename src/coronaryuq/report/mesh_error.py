"""Numerical error of the 3D quantities, in words for the report."""

from pathlib import Path

import numpy as np

from coronaryuq.core import provenance
from coronaryuq.core.io.atomic import read_json
from coronaryuq.flow3d.mesh_study import read_discretization
from coronaryuq.flow3d.numerical_error import ASSUMED, NumericalError

EXTREMES = {"tawss_min_": "min TAWSS (dyn/cm²)", "osi_max_": "max OSI"}
"""Quantities that have settled on no mesh tried, by the beginning of their 3D columns."""
WORDS = {"mesh": "mesh", "time_step": "time step", "cycles": "cycles"}
COMPARE = "they are valid only for comparing states on the same mesh."
SLOW = f"Extremes of wall shear and OSI converge slowly: {COMPARE}"
NORMAL_95 = 1.96


class MeshError:
    """Error of mesh, time step and number of cycles of each 3D quantity, if the mesh study was run on this mesh.

    Parameters
    ----------
    mesh
        mesh.json of the campaign.
    study
        mesh_study.json, or None.
    assumed
        Whether estimates include an assumed error, because that of the mesh was not measured.
    """

    def __init__(self, mesh: str | Path, study: str | Path | None, assumed: bool = False):
        self.mesh, self.assumed = read_json(mesh), assumed
        self.study = read_json(study, ("checksum", "nodes", "not_measured")) if study else None
        self.of_another_mesh = self.study is not None and self.study["checksum"] != provenance.checksum(mesh)
        self.errors: dict[str, list[NumericalError]] = {}
        if study and not self.of_another_mesh:
            self.errors = read_discretization(study)

    def of(self, column: str, scale: float = 1.0) -> str:
        """Return the correction that the mesh asks for and the 95 % interval of each source, or nothing.

        All have the digits of the largest; sources that are zero in these are left out. scale: of the numbers shown.
        """
        errors = self.errors.get(column, ())
        largest = max((NORMAL_95 * error.std * scale for error in errors), default=0.0)
        decimals = max(0, 1 - int(np.floor(np.log10(largest)))) if largest > 0 else 0
        words = (_words(error, scale, decimals) for error in errors)
        return ", ".join(filter(None, words))

    @property
    def sentence(self) -> str:
        settings = self.mesh["settings"]
        mesh = (
            f"3D runs used a mesh of {self.mesh['nodes']:,} nodes with {settings['throat_resolution']:g} elements over "
            "the radius of a throat. "
        )
        if self.study is None or self.of_another_mesh:
            state = "was measured on another mesh" if self.of_another_mesh else "was not measured"
            return (
                mesh
                + f"Its error {state}; the target `mesh_study` of the workflow measures it. {self._assumed()}{SLOW}"
            )
        missing = "".join(
            f"The error of the {WORDS[source]} was not measured: {reason}. "
            for source, reason in self.study["not_measured"].items()
        )
        return mesh + self._measured() + missing + self._assumed() + self._reliability()

    def _assumed(self) -> str:
        """Return what was assumed in place of a measured error."""
        if not self.assumed:
            return ""
        ffr, drop = (
            f"{100 * ASSUMED[name] / self.mesh['settings']['throat_resolution'] ** 2:.0f} %"
            for name in ("ffr_", "pressure_drop_")
        )
        return (
            f"Instead, intervals include errors of the usual size on meshes of this resolution: {ffr} of 1 − FFR and "
            f"{drop} of a pressure drop (one standard deviation). "
        )

    def _measured(self) -> str:
        """Return what the numbers beside the estimates mean."""
        if not self.errors:
            return ""
        samples = min(error.n_samples for errors in self.errors.values() for error in errors)
        sizes = ", ".join(f"{nodes:,}" for nodes in self.study["nodes"]) if self.study else ""
        return (
            f"Numerical errors of the mean were measured on {samples} or more of the samples, on meshes of {sizes} "
            "nodes: ± is half of a 95 % interval, which the intervals of the estimates include. A signed number before "
            "it is a correction, which the means include: the meshes showed an order of convergence. "
        )

    def _reliability(self) -> str:
        """Return how far values on this mesh can be trusted."""
        if not any(error.source == "mesh" for errors in self.errors.values() for error in errors):
            return SLOW
        ffr = [_largest(errors) for name, errors in self.errors.items() if name.startswith("ffr_")]
        accuracy = f"On this mesh FFR is accurate to {max(ffr):.2g} at the worst stenosis" if ffr else ""
        named = [errors for name, errors in self.errors.items() if name.startswith(tuple(EXTREMES))]
        extremes = [error for errors in named for error in errors]
        if all(error.method == "richardson" for error in extremes if error.source == "mesh"):
            return f"{accuracy}." if accuracy else ""
        return f"{accuracy + '; e' if accuracy else 'E'}xtremes of wall shear and OSI have not converged: {COMPARE}"


def _words(error: NumericalError, scale: float, decimals: int) -> str:
    correction, reach = error.correction * scale, NORMAL_95 * error.std * scale
    if round(correction, decimals) == 0 and round(reach, decimals) == 0:
        return ""
    corrected = f"{correction:+.{decimals}f} ".replace("-", "−") if correction else ""
    return f"{WORDS[error.source]} {corrected}± {reach:.{decimals}f}"


def _largest(errors: list[NumericalError]) -> float:
    """Return the end of the 95 % interval of the joint error that is furthest from the uncorrected mean."""
    correction = sum(error.correction for error in errors)
    return abs(correction) + NORMAL_95 * float(np.sqrt(sum(error.std**2 for error in errors)))
