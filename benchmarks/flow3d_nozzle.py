"""Draw pictures/flow3d-nozzle.png: the FDA nozzle at Re 500, simulated and measured. Argument: the measured files."""

import sys
from pathlib import Path

import numpy as np

from coronaryuq.bench.flow3d import nozzle
from coronaryuq.core.units import PRESSURES
from coronaryuq.figures.style import MEASURED, SIMULATED, saved


def main(folder: str) -> None:
    flow, exact, laboratories = nozzle.solve(), nozzle.reference(), nozzle.measured(folder)
    with saved(
        Path(__file__).parents[1] / "docs" / "pictures" / "flow3d-nozzle.png", nrows=2, figsize=(7, 6), sharex=True
    ) as (
        _,
        (above, below),
    ):
        above.plot(flow.z, flow.axial, color=SIMULATED, label=f"here, {flow.nodes:,} nodes")
        below.plot(
            flow.pressure_z, (flow.pressure - np.interp(0.0, flow.pressure_z, flow.pressure)) / PRESSURES["Pa"],
            color=SIMULATED,
        )  # fmt: skip
        above.plot(exact.z, exact.axial, "--", color="0.3", lw=1, label="axisymmetric solution")
        zero = np.interp(0.0, exact.pressure_z, exact.pressure)
        below.plot(exact.pressure_z, (exact.pressure - zero) / PRESSURES["Pa"], "--", color="0.3", lw=1)
        for marker, (name, curves) in zip("os^v", laboratories.items(), strict=False):
            z, axial = curves["axial"].T
            above.plot(z, axial, marker, color=MEASURED, fillstyle="none", label=f"laboratory {name}")
            z, pressure = curves["pressure"].T
            zero = pressure[np.argmin(np.abs(z))]
            below.plot(z, (pressure - zero) / PRESSURES["Pa"], marker, color=MEASURED, fillstyle="none")
        above.axvspan(nozzle.BREAKDOWN, 9.0, color="0.93", lw=0)
        above.set(ylabel="velocity on the axis (cm/s)", xlim=(-9.6, 9.0), ylim=(0, None))
        above.legend(loc="upper left")
        below.set(xlabel="distance from the expansion (cm)", ylabel="wall pressure less that at the expansion (Pa)")


if __name__ == "__main__":
    main(sys.argv[1])
