"""Folds of cross-fitting: who is held out with whom, and which propagation samples go with which fold."""

import numpy as np

from coronaryuq.core.seeds import generator

SMALL = 100


def count(n: int, folds: int) -> int:
    """Folds for n runs: as set, twice as many below SMALL runs, where every training run counts; at most n."""
    return min(n, 2 * folds if n < SMALL else folds)


def assign(n: int, k: int, seed: int, *name: str | int) -> np.ndarray:
    """Fold (n,) of each sample, sizes equal to within one, in a random order named by `name`."""
    return generator(seed, "estimation", "folds", *name).permutation(np.arange(n) % k)
