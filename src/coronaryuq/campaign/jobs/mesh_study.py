"""Compare the runs of the mesh study."""

from coronaryuq.flow3d.mesh_study import mesh_study


def compare_meshes(
    coarse: tuple[str, str], campaign: tuple[str, str], fine: tuple[str, str], half_step: str, out_json: str
) -> None:
    """Write the numerical error from the description and records of each mesh, and records with half the step."""
    meshes = {"coarse": coarse, "campaign": campaign, "fine": fine}
    mesh_study({name: (mesh, records) for name, (mesh, records) in meshes.items()}, "campaign", half_step, out_json)
