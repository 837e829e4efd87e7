"""The paper's own runs, and small folders of runs made for a test."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.seeds import generator


@pytest.fixture(scope="session")
def menon(shared) -> Path:
    return shared / "data" / "menon2024"


@pytest.fixture
def folder(tmp_path) -> Path:
    """A small campaign's `runs/`: 40 pilot runs, 200 propagation runs, two inputs, one 3D and two 0D quantities."""
    rng = generator(7, "runs")
    theta, more = rng.uniform(0.5, 2, (40, 2)), rng.uniform(0.5, 2, (200, 2))
    names = [f"sample_{i:04d}" for i in range(40)]
    names_more = [f"propagation_{i:04d}" for i in range(200)]

    def table(names, columns):
        return pd.DataFrame({"sample": names, **columns})

    def low(t):
        return {"mean_flow:lca1:BC_lca1": 1 / t[:, 0], "ffr_lad": 1 - 0.2 / t[:, 1]}

    table(names, {"BC_lca1": theta[:, 0], "R_cor_scaling": theta[:, 1]}).to_csv(tmp_path / "params.csv", index=False)
    table(names, {"osi": np.sin(theta[:, 0]) + 0.01 * rng.normal(size=40)}).to_csv(
        tmp_path / "outputs_3d.csv", index=False
    )
    table(names, low(theta)).to_csv(tmp_path / "outputs_0d.csv", index=False)
    table(names_more, {"BC_lca1": more[:, 0], "R_cor_scaling": more[:, 1]}).to_csv(
        tmp_path / "params_propagation.csv", index=False
    )
    table(names_more, low(more)).to_csv(tmp_path / "outputs_0d_propagation.csv", index=False)
    rows = {"row": ["1"], "column_3d": ["osi"], "column_0d": ["mean_flow:lca1:BC_lca1"]}
    pd.DataFrame(rows).to_csv(tmp_path / "rows.csv", index=False)
    return tmp_path


@pytest.fixture
def with_coarse(folder):
    """The small campaign with a coarse level: its pilot and 120 inputs more."""
    rng = generator(7, "coarse")
    names = ["BC_lca1", "R_cor_scaling"]
    beyond = pd.DataFrame(rng.uniform(0.5, 2, (120, 2)), columns=names)
    beyond.insert(0, "sample", [f"sample_{i:04d}" for i in range(40, 160)])
    beyond.to_csv(folder / "params_coarse.csv", index=False)
    low = {"mean_flow:lca1:BC_lca1": 1 / beyond["BC_lca1"], "ffr_lad": 1 - 0.2 / beyond["R_cor_scaling"]}
    pd.DataFrame({"sample": beyond["sample"], **low}).to_csv(folder / "outputs_0d_coarse.csv", index=False)
    lines = pd.concat([pd.read_csv(folder / "params.csv"), beyond])
    lines = lines.assign(osi=np.sin(lines["BC_lca1"]) + 0.02 * lines["R_cor_scaling"])
    lines[["sample", "osi"]].to_csv(folder / "outputs_3d_coarse.csv", index=False)
    return folder
