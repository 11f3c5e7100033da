"""Normal equations of robust fits, summed over each group of rows that the same folds use: leaving
a fold out costs no further pass.
"""

from collections.abc import Sequence

import numpy as np

CHUNK = 4096  # rows that are weighted at once: they stay in the processor's cache


class Groups:
    """Groups of rows (n,): of each, which folds train on it, which fold tests it (-1: none), and
    the rows as stretches of the log.
    """

    def __init__(self, folds: Sequence[tuple[np.ndarray, np.ndarray]]) -> None:
        masks = np.array([train for train, _ in folds] + [test for _, test in folds])
        code = (masks * (1 << np.arange(len(masks)))[:, None]).sum(axis=0)
        _, first, group = np.unique(code, return_index=True, return_inverse=True)
        self.count, self.rows = len(first), len(code)
        self.trains = masks[: len(folds), first]
        self.tested_by = np.where(
            masks[len(folds) :, first].any(axis=0), masks[len(folds) :, first].argmax(axis=0), -1
        )
        cuts = np.union1d(
            np.flatnonzero(np.diff(group, prepend=-1)), np.arange(0, self.rows, CHUNK)
        )
        self.stretches = [
            (slice(int(a), int(b)), int(group[a]))
            for a, b in zip(cuts, [*cuts[1:], self.rows], strict=True)
        ]

    def sums(self, columns: np.ndarray, residual: np.ndarray, delta: float) -> np.ndarray:
        """Of each group J'WJ and J'Wr side by side (groups, p, p + 1), for columns J (n, p),
        residuals r (n,) and Huber's weights W.
        """
        p = columns.shape[1]
        out = np.zeros((self.count, p, p + 1))
        for rows, group in self.stretches:
            both = np.empty((p + 1, rows.stop - rows.start))
            both[:p], both[p] = columns[rows].T, residual[rows]
            out[group] += (both[:p] * huber_weight(both[p], delta)) @ both.T
        return out

    def moved(self, residual: np.ndarray, columns: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Residuals (n,) after the step (groups, p) of each row's group."""
        out = np.empty(self.rows)
        for rows, group in self.stretches:
            np.add(residual[rows], columns[rows] @ steps[group], out=out[rows])
        return out


def huber_weight(residual: np.ndarray, delta: float) -> np.ndarray:
    """Weight of each residual, 1 up to delta."""
    return np.minimum(1.0, delta / np.maximum(np.abs(residual), 1e-9))


def huber(residual: np.ndarray, delta: float) -> float:
    """Huber's loss of residuals, square near 0."""
    size = np.abs(residual)
    near = np.minimum(size, delta)
    return float(near @ (2.0 * size - near))
