"""The unknown source of flow of a search that names nothing: an entry of its answer, and its waveform as a table."""

import numpy as np
import pandas as pd

from coronaryuq.discrepancy.selection.unknown_source import LAWS, UnknownSource
from coronaryuq.zerod.effects.base import Z_90

COLUMNS = ["condition", "phase", "flow", "low", "high", "vessel"]


def source_entry(nodes: list[tuple[str, float]], source: UnknownSource | None) -> dict | None:
    """Return the entry of `discrepancy.json`: nodes, and place and laws of the best; None where none was sought."""
    if not nodes:
        return None
    entry: dict = {"nodes": [{"vessel": vessel, "nats": nats} for vessel, nats in nodes]}
    if source is None:
        return entry
    sizes = {law: [size + step * sd for step in (0.0, -Z_90, Z_90)] for law, (size, sd) in source.sizes.items()}
    return entry | {"vessel": source.place, "law": source.law, "laws": source.laws, "says": LAWS, "sizes": sizes}


def source_table(source: UnknownSource | None) -> pd.DataFrame:
    """Tabulate the flow that leaves, mL/s, and its 90 % interval by condition and phase of the beat; may be empty."""
    if source is None:
        return pd.DataFrame(columns=COLUMNS)
    parts = []
    for condition, (flow, sd) in source.waveforms.items():
        columns = {"phase": np.arange(len(flow)) / len(flow), "flow": flow}
        columns |= {"low": flow - Z_90 * sd, "high": flow + Z_90 * sd}
        parts.append(pd.DataFrame({"condition": condition, **columns, "vessel": source.place}))
    return pd.concat(parts, ignore_index=True)
