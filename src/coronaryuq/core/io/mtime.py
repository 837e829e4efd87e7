"""Repair of modification times later than now, left by a clock that was ahead and has since been set.

Snakemake stops at a result that is older than its inputs; with inputs from the future it would stop.
"""

import os
import time
from pathlib import Path

TOLERANCE_S = 2.0
"""Allowed difference between the clocks of a cluster's machines."""


def reset_future_times(folder: str | Path) -> list[Path]:
    """Set modification times later than now to the present, keeping their order; return the changed files.

    All other files are older and are not changed.
    """
    now = time.time_ns()
    dated = [(path.stat().st_mtime_ns, path) for path in Path(folder).rglob("*") if path.is_file()]
    ahead = sorted((modified, path) for modified, path in dated if modified > now + TOLERANCE_S * 1e9)
    for number, (_, path) in enumerate(ahead):
        present = now - (len(ahead) - number) * 1_000_000
        os.utime(path, ns=(present, present))
    return [path for _, path in ahead]
