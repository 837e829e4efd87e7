"""The 0D side of 3D runs: losses that 3D runs taught belong to vessels that the mesh replaces."""

from pathlib import Path

from coronaryuq.core.io.atomic import read_json
from coronaryuq.zerod.network.read import read_network, write_network


def for_3d(hyperaemia_json: str | Path, fit_json: str | Path, out_json: str | Path) -> None:
    """Write the tuned loop for 3D runs: its vessels have their own losses, as those learnt are of what 3D replaces."""
    network = read_network(hyperaemia_json)
    for vessel, values in read_json(fit_json, ("own",))["own"].items():
        network.vessel_values(vessel).update(values)
    write_network(out_json, network)
