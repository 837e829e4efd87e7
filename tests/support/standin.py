"""Programs that stand in for svpre, svsolver and svpost: at once done, with answers that are known functions of θ.

x is the mean logarithm of the coronary beds' arterial resistances, as the solver's own 0D file gives them. Runs named
in `faults.json` beside the programs fail as real ones do: they diverge, hang, or leave a file cut short. With `install`
the three programs are written into a folder.
"""

import json
import os
import re
import sys
import time
from pathlib import Path

import numpy as np

PROGRAMS = ("svpre", "svsolver", "svpost")


def install(folder: Path, faults: dict[str, str]) -> dict:
    """Write the programs and what shall fail; returns the settings that name them."""
    folder.mkdir(parents=True)
    for name in PROGRAMS:
        program = folder / name
        program.write_text(f"#!{sys.executable}\n{Path(__file__).read_text()}")
        program.chmod(0o755)
    (folder / "faults.json").write_text(json.dumps(faults))
    return {name: (folder / name).as_posix() for name in PROGRAMS}


def mean_log_resistance(network: dict) -> float:
    values = [block["bc_values"] for block in network["boundary_conditions"]]
    return float(
        np.mean([np.log(held["Ra1" if "Ra1" in held else "Ra"]) for held in values if "Ra" in held or "Ra1" in held])
    )


def ffr(x):
    return 0.06 * x + 0.1


def forward(x):
    """Wall shear stress in three frames of four, dyn/cm2."""
    return 8.0 * (x - 5.0)


def backward(x):
    """Share of it that the fourth frame has, backwards."""
    return 0.05 * x


def tawss(x):
    return forward(x) * (3.0 + backward(x)) / 4.0


def osi(x):
    return backward(x) / (3.0 + backward(x))


def solve(run: Path, faults: dict[str, str]) -> None:
    network = json.loads((run / "svzerod_3d_coupling.json").read_text())
    fault = faults.get(run.name)
    if fault == "hangs":
        time.sleep(3600)
    if fault == "diverges":
        print("Error: residual is NaN at step 17")
        sys.exit(1)
    steps = int(re.search(r"Number of Timesteps: (\d+)", (run / "solver.inp").read_text())[1])
    state = network["initial_condition"]
    row = " ".join(f"{value!r}" for value in state.values())
    lines = [f"{len(state)} {' '.join(state)}", *(f"{k} {row}" for k in range(steps))]
    (run / "svZeroD_data").write_text("\n".join(lines) + "\n")


def gather(run: Path, arguments: dict[str, str], fault: str | None) -> None:
    network = json.loads((run / "svzerod_3d_coupling.json").read_text())
    x = mean_log_resistance(network)
    aortic = next(
        value for name, value in network["initial_condition"].items() if name.startswith("pressure:J_heart_outlet")
    )
    with open(run / "initial.vtu", "rb") as opened:
        nodes = int(re.search(rb'NumberOfPoints="(\d+)"', opened.read(4000))[1])
    one = np.ones(nodes)
    ids = " ".join(map(str, range(1, nodes + 1)))
    volume, wall = [_array("GlobalNodeID", "Int32", 1, ids)], [_array("GlobalNodeID", "Int32", 1, ids)]
    frames = range(int(arguments["-start"]), int(arguments["-stop"]) + 1, int(arguments["-incr"]))
    for number, step in enumerate(frames):
        volume.append(_array(f"pressure_{step:05d}", "Float64", 1, _text(aortic * ffr(x) * one)))
        size = -backward(x) * forward(x) if number % 4 == 3 else forward(x)
        wall.append(_array(f"vWSS_{step:05d}", "Float64", 3, _text(np.outer(one, [0.0, size, 0.0]))))
    cells = ("connectivity", "Int64"), ("offsets", "Int64"), ("types", "UInt8")
    empty = "".join(_array(name, kind, 1, "") for name, kind in cells)
    whole = _vtk(
        "UnstructuredGrid", f'NumberOfPoints="{nodes}" NumberOfCells="0"', volume, nodes, f"<Cells>{empty}</Cells>"
    )
    (run / arguments["-vtu"]).write_text(whole[: len(whole) // 2] if fault == "cut short" else whole)
    (run / arguments["-vtp"]).write_text(
        _vtk("PolyData", f'NumberOfPoints="{nodes}" NumberOfVerts="0"', wall, nodes, "")
    )


def _array(name: str, kind: str, components: int, text: str) -> str:
    return (
        f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" format="ascii">{text}</DataArray>\n'
    )


def _text(values: np.ndarray) -> str:
    return " ".join(f"{value!r}" for value in np.ravel(values).tolist())


def _vtk(kind: str, counts: str, arrays: list[str], nodes: int, cells: str) -> str:
    points = _array("Points", "Float32", 3, "0 0 0 " * nodes)
    return (
        f'<?xml version="1.0"?><VTKFile type="{kind}" version="1.0" byte_order="LittleEndian"><{kind}><Piece {counts}>'
        f"<PointData>{''.join(arrays)}</PointData><Points>{points}</Points>{cells}</Piece></{kind}></VTKFile>\n"
    )


def main() -> None:
    here, run = Path(__file__).parent, Path.cwd()
    faults = json.loads((here / "faults.json").read_text())
    program = Path(__file__).name
    if program == "svsolver" and os.environ.get("PMI_RANK", os.environ.get("SLURM_PROCID", "0")) == "0":
        solve(run, faults)
    if program == "svpost":
        words = sys.argv[1:]
        gather(
            run, {word: words[k + 1] for k, word in enumerate(words[:-1]) if word.startswith("-")}, faults.get(run.name)
        )


if __name__ == "__main__":
    main()
