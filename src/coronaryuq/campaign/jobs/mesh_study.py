"""Compare the runs of the mesh study with the campaign's."""

from collections.abc import Sequence

from coronaryuq.core import records
from coronaryuq.core.io.atomic import read_json
from coronaryuq.flow3d.mesh_study import MeshRuns, mesh_study


def compare_levels(
    own_mesh: str, own_runs: Sequence[str], own_costs: Sequence[str], meshes: Sequence[str], runs: Sequence[str],
    long_step: Sequence[str], costs: Sequence[str], n_3d: int, out_json: str,
) -> None:  # fmt: skip
    """Write the numerical errors.

    own_...: mesh.json, records and costs of batches of the campaign; meshes, runs: mesh.json and records of every
    other mesh; long_step: records of longer time steps, if there are any; costs: of the jobs of the study; n_3d: 3D
    runs of the campaign.
    """
    per_run = _cpu_s(own_costs) / max(sum(len(records.read(path)) for path in own_runs), 1)
    total = _cpu_s(costs)
    cost = {"cpu_s": total, "cpu_s_per_3d_run": per_run, "fraction_of_3d": total / max(n_3d * per_run, 1e-12)}
    others = [MeshRuns(mesh, [path]) for mesh, path in zip(meshes, runs, strict=True)]
    longer = MeshRuns(own_mesh, long_step) if long_step else None
    mesh_study(MeshRuns(own_mesh, own_runs), others, longer, cost, out_json)


def _cpu_s(paths: Sequence[str]) -> float:
    return float(sum(read_json(path, ("cpu_s",))["cpu_s"] for path in paths))
