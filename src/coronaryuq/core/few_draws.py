"""What few draws of many values have in common, and what each has of its own."""

import numpy as np


def principal(deviations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lengths (k,) and shapes (k, N): principal components of the rows of (n, N)."""
    _, lengths, directions = np.linalg.svd(deviations / np.sqrt(len(deviations)), full_matrices=False)
    return lengths, lengths[:, None] * directions


def left_by_others(draws: np.ndarray) -> np.ndarray:
    """Return the part of each row of (n, N) that mean and shapes of the others do not explain, over the root of n."""
    left = []
    for number, row in enumerate(draws):
        others = np.delete(draws, number, axis=0)
        shapes = (others - others.mean(axis=0)) / np.sqrt(len(others) - 1)
        missing = row - others.mean(axis=0)
        weights = np.linalg.solve(np.eye(len(shapes)) + shapes @ shapes.T, shapes @ missing)
        left.append(missing - weights @ shapes)
    return np.array(left) / np.sqrt(len(left))
