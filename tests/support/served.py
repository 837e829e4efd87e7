"""A small campaign whose models can be served, and a server that really runs."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from coronaryuq.core.io.atomic import read_json, write_json, write_text
from coronaryuq.posterior import stage
from coronaryuq.posterior.settings import DreamSettings, EmulatorSettings, IndependenceSettings, Settings
from support.case_files import write_case_json, write_perfusion_targets
from support.resistor_tree import ResistorTree, network_of, targets_of

LAD = {"vessel": "v0", "ffr": "v0:BC_0", "flow": "J0:v0", "root": "J0:v0", "outlet": "BC_0"}
BEDS = 3
POSTERIOR = Settings(
    dream=DreamSettings(chains=12, generations=400), emulator=EmulatorSettings(generations=4),
    independence=IndependenceSettings(draws=40),
)  # fmt: skip
CAMPAIGN = """
name: tiny
case: given/case.yaml
posterior: {dream: {chains: 12, generations: 400}, emulator: {generations: 4}, independence: {draws: 40}}
zerod: {batch: 8}
flow3d: {steps_per_cycle: 100, max_cycles: 2, ramp_cycles: 0.1, wall_samples_per_cycle: 20}
"""


def small_campaign(folder: Path, **case_values) -> Path:
    """Write `results/tiny` of a tree of resistors with three beds, their posterior sampled for real; return it.

    With `errors` in the case the borders of their territories are uncertain.
    """
    home = folder / "results" / "tiny"
    for part in ("case", "calibration", "posterior", "perfusion"):
        (home / part).mkdir(parents=True)
    write_text(home / "campaign.yaml", CAMPAIGN)
    loop, case = home / "calibration" / "hyperaemia.json", home / "case" / "case.json"
    tree = ResistorTree.of(BEDS)
    write_json(loop, network_of(tree))
    outlets = [{"name": f"v{k}", "bc": f"BC_{k}"} for k in range(BEDS)]
    write_case_json(case, outlets=outlets, stenoses=[LAD], name="tiny", aorta={"pressure": "AORTA:root"}, **case_values)
    names = [outlet["bc"] for outlet in outlets]
    targets = write_perfusion_targets(home / "perfusion" / "targets.json", names, *targets_of(tree))
    if "errors" in case_values:
        content = read_json(targets)
        share = np.array([0.2, -0.15, 0.05]) * np.array(content["mean"])
        content["further"] = {"territories": np.outer(share, share).tolist()}
        content["covariance"] = (np.array(content["covariance"]) + np.outer(share, share)).tolist()
        write_json(targets, content)
    out = home / "posterior"
    chains = out / "length_1" / "chains.npz"
    stage.sample(case, loop, targets, POSTERIOR, 3, chains)
    files = ("posterior.nc", "draws.csv", "summary.json", "fractions.csv", "fitted.json")
    stage.gather(case, loop, targets, chains, POSTERIOR, 3, stage.GatheredFiles(*(out / n for n in files)))
    return home


@contextmanager
def served(home: Path, *options: str) -> Iterator[tuple[str, list[str]]]:
    """Serve a campaign at a free port; gives the address and the lines that the server printed before."""
    command = [sys.executable, "-u", "-m", "coronaryuq.cli.main", "serve", str(home), "--port", "0", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        lines: list[str] = []
        try:
            assert server.stdout is not None
            for line in server.stdout:
                lines.append(line.strip())
                if " at http://" in line:
                    break
            else:
                raise AssertionError(f"the server ended: {lines}")
            yield lines[-1].split(" at ")[1].split(";")[0], lines
        finally:
            server.terminate()
