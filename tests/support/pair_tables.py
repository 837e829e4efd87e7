"""Tables of simulated and measured outputs of one branch, for tests of the search on table models."""

from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.discrepancy.table_model.tables import Branch, branches, read_pairs

ZERO_FLOW = 5.0


def noisy_pairs(
    folder: Path,
    seed: int,
    count=60,
    quadratic=0.0,
    linear=0.0,
    offset=0.0,
    gain=0.0,
    flow_gain=0.0,
    ffr=0.002,
    outlet=0.01,
    power=2,
) -> tuple[Path, Path]:
    """Write tables of one branch with a loss and sensor errors; noise of FFR, and relative noise at the outlet."""
    random = np.random.default_rng(seed)
    root, own, beyond = 86.0 - 3.0 * random.random(count), 3.0, 2.0
    bed = 60.0 * random.uniform(0.5, 2.0, count) * random.uniform(0.7, 1.25, count)
    simulated = (root - ZERO_FLOW) / (own + beyond + bed)
    low, high = np.zeros(count), simulated.copy()
    for _ in range(60):
        flow = 0.5 * (low + high)
        left = root - ZERO_FLOW - (own + linear + beyond + bed) * flow - quadratic * flow**power
        low, high = np.where(left > 0.0, flow, low), np.where(left > 0.0, high, flow)
    distal = root - (own + linear) * flow - quadratic * flow**power
    end = distal - beyond * flow
    noise = random.normal(size=(3, count))
    read = {
        "sample": [f"s{i}" for i in range(count)],
        "mean_pressure:heart:aorta": root,
        "mean_pressure:v1:BC": end * (1.0 + outlet * noise[0]),
        "mean_flow:v1:BC": flow * (1.0 + flow_gain) * (1.0 + outlet * noise[1]),
        "ffr_x": (distal * (1.0 + gain) + offset) / root + ffr * noise[2],
    }
    own_distal = root - own * simulated
    made = {
        "sample": read["sample"],
        "mean_pressure:heart:aorta": root,
        "mean_pressure:v0:J": own_distal,
        "mean_flow:v0:J": simulated,
        "mean_pressure:v1:BC": own_distal - beyond * simulated,
        "mean_flow:v1:BC": simulated,
        "ffr_x": own_distal / root,
    }
    for name, table in (("0d.csv", made), ("3d.csv", read)):
        pd.DataFrame(table).to_csv(folder / name, index=False)
    return folder / "0d.csv", folder / "3d.csv"


def exact_pairs(folder: Path, quadratic: float, count: int = 120) -> tuple[Path, Path]:
    """Write tables of one branch whose measured side has a quadratic loss that the simulated side lacks."""
    random = np.random.default_rng(1)
    bed, own, root = 60.0 * random.uniform(0.7, 1.4, count), 3.0, 95.0 + random.normal(0, 2, count)
    simulated, measured = {}, {}
    for table, loss in ((simulated, 0.0), (measured, quadratic)):
        series = own + bed
        flow = 2 * root / (series + np.sqrt(series**2 + 4 * loss * root))
        distal = bed * flow
        table |= {"sample": range(count), "mean_pressure:heart:aorta": root, "mean_pressure:v:BC": distal}
        table |= {"mean_flow:v:BC": flow, "ffr_x": distal / root}
    for name, table in (("0d.csv", simulated), ("3d.csv", measured)):
        pd.DataFrame(table).to_csv(folder / name, index=False)
    return folder / "0d.csv", folder / "3d.csv"


def read_branch(files: tuple[Path, Path]) -> Branch:
    """Read the only branch of both tables."""
    (branch,) = branches(*read_pairs(*files), *files)
    return branch


def rewrite(file: Path, change) -> None:
    """Replace a table by `change(table)`."""
    table = pd.read_csv(file)
    change(table).to_csv(file, index=False)
