"""Random numbers named by their purpose, so that results do not depend on process count or order of computation."""

import hashlib

import numpy as np


def generator(seed: int, *name: str | int) -> np.random.Generator:
    """Return a random generator for one purpose.

    The same seed and name give the same stream on any machine, process count or batch size; different names give
    independent streams (Philox keyed by SHA-256 of seed and name).

    Parameters
    ----------
    seed
        Seed of the campaign.
    *name
        Purpose, such as ("perfusion", "realisation", 17). The number 2 and the text "2" are different names.
    """
    parts = [part if isinstance(part, str) else int(part) for part in name]
    text = "\x1f".join([str(int(seed)), *(f"{type(part).__name__[0]}{part}" for part in parts)])
    key = np.frombuffer(hashlib.sha256(text.encode()).digest()[:16], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key))
