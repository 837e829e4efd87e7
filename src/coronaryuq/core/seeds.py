"""Random numbers named by what they are for, so that a result does not depend on who computes it, or in what order."""

import hashlib

import numpy as np


def generator(seed: int, *name: str | int) -> np.random.Generator:
    """Generator for one purpose: the campaign's seed and a name such as ("perfusion", "realisation", 17).

    The same seed and name give the same stream on any machine, process count or batch size; different names give
    independent streams (Philox keyed by SHA-256 of seed and name).
    """
    text = "\x1f".join([str(int(seed)), *(f"{type(part).__name__[0]}{part}" for part in map(_plain, name))])
    key = np.frombuffer(hashlib.sha256(text.encode()).digest()[:16], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key))


def _plain(part: str | int) -> str | int:
    return part if isinstance(part, str) else int(part)
