"""`mesh.json` as a typed object: what a flow solver needs beside the mesh's nodes (docs/reference/formats.md)."""

from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.typed import checked

FORMAT = "coronaryuq-mesh-1"

Vector = tuple[float, float, float]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, populate_by_name=True)


class Couples(_Part):
    """The 0D connection `upstream:downstream` that a cap cuts, and whether blood flows into or out of 3D there."""

    upstream: str
    downstream: str
    flow: Literal["in", "out"]

    @property
    def enters(self) -> bool:
        """Whether blood enters the 3D domain here."""
        return self.flow == "in"

    @property
    def cuts_vessel(self) -> bool:
        """Whether the cap cuts a 0D vessel in the middle rather than a connection."""
        return self.upstream == self.downstream


class Face(_Part):
    """A wall or a cap: area (cm2) and, for caps, centroid (cm), outward unit normal, radius (cm) and coupling."""

    name: str
    kind: Literal["wall", "cap"]
    number: int | None = Field(None, alias="ModelFaceID")
    area: float | None = None
    centroid: Vector | None = None
    normal: Vector | None = None
    radius: float | None = None
    couples: Couples | None = None


class Remainder(_Part):
    """What stays in 0D of a vessel cut in the middle, as a fraction of each element on either side of the 3D part."""

    upstream: dict[str, float] | None = None
    downstream: dict[str, float] | None = None


class Region(_Part):
    """Stretch of wall around a stenosis; `start` and `end` (cm) are distances from the throat along the artery."""

    id: int
    vessel: str = ""
    throat: float = 0.0
    throat_radius: float = 0.0
    start: float = Field(0.0, alias="from")
    end: float = Field(0.0, alias="to")
    triangles: int = 0
    area: float = 0.0


class Plane(_Part):
    """Cross-section beside a stenosis: point and radius (cm), unit normal pointing downstream."""

    point: Vector
    normal: Vector
    radius: float = 0.0
    vessel: str = ""
    arc: float = 0.0
    distance_from_throat: float = 0.0


class MeshDescription(_Part):
    """Content of `mesh.json`; docs/reference/formats.md says what each entry means."""

    format: str = FORMAT
    domain: str = ""
    nodes: int = 0
    tets: int = 0
    volume: float = 0.0
    pieces: list[dict[str, tuple[float, float]]] = []
    faces: list[Face]
    replaces: list[str] = []
    cut: dict[str, Remainder] = {}
    regions: dict[str, Region]
    planes: dict[str, Plane]
    proximal_planes: dict[str, Plane] = {}
    quality: dict[str, Any] = {}
    failed_attempts: list[str] = []
    settings: dict[str, Any] = {}

    @property
    def caps(self) -> dict[str, Couples]:
        """What each cap couples, in the order of the faces."""
        return {face.name: face.couples for face in self.faces if face.couples is not None}

    def content(self) -> dict[str, Any]:
        """Return the JSON object that the file holds."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)


def read_description(path: str | Path) -> MeshDescription:
    """Read a mesh's description.

    Parameters
    ----------
    path
        `mesh.json`.

    Returns
    -------
    MeshDescription
        Faces, couplings, cut vessels, stenosis regions and planes.

    Raises
    ------
    InputError
        The file is missing or malformed, or an entry is absent or of the wrong type.
    """
    content = read_json(path, ("faces", "regions", "planes"))
    description = checked(MeshDescription, content, path)
    for face in description.faces:
        if face.kind == "cap" and face.couples is None:
            raise InputError(path, f"faces.{face.name}", None, "cap without `couples`; regenerate the mesh")
    return description
