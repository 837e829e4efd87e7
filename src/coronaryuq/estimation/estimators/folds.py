"""Folds of cross-fitting: how many, and which samples are held out together."""

import numpy as np

from coronaryuq.core.seeds import generator

SMALL = 100


def count(n: int, folds: int) -> int:
    """Return the number of folds for n runs: as set, but twice as many below SMALL runs; at most n.

    In a small pilot every training run counts, so that less is held out at a time.
    """
    return min(n, 2 * folds if n < SMALL else folds)


def assign_groups(groups: np.ndarray, k: int, seed: int, *name: str | int) -> np.ndarray:
    """Return the fold (n,) of each of n samples such that those of one group (n,) are in one fold.

    Groups are dealt out at random, each to the smallest fold so far, the largest groups first.
    """
    sizes = np.bincount(groups)
    order = generator(seed, "estimation", "folds", *name).permutation(len(sizes))
    fold, filled = np.empty(len(sizes), dtype=int), np.zeros(k, dtype=int)
    for group in order[np.argsort(-sizes[order], kind="stable")]:
        fold[group] = filled.argmin()
        filled[fold[group]] += sizes[group]
    return fold[groups]


def assign(n: int, k: int, seed: int, *name: str | int) -> np.ndarray:
    """Return the fold (n,) of each of n samples: k folds of equal size to within one, at random.

    Parameters
    ----------
    n, k
        Numbers of samples and of folds.
    seed, name
        Seed of the campaign, and what the folds are for.
    """
    return generator(seed, "estimation", "folds", *name).permutation(np.arange(n) % k)
