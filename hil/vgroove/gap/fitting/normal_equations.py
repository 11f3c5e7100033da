"""Normal equations of robust fits, summed over each group of rows that the same folds use, so that
a fit without one fold needs no further pass over the rows.
"""

from collections.abc import Sequence

import numpy as np

from vgroove.gap.residual.huber import huber_weight

CHUNK_ROWS = 4096  # rows that are weighted at once: their columns fit into a processor's cache


class FoldGroups:
    """Groups of rows (n,) that the same folds use: which folds train on each group, which fold
    tests it (-1: none), and slices of consecutive rows of one group.
    """

    def __init__(self, folds: Sequence[tuple[np.ndarray, np.ndarray]]) -> None:
        masks = np.array([train for train, _ in folds] + [test for _, test in folds])
        code = (masks * (1 << np.arange(len(masks)))[:, None]).sum(axis=0)
        _, first, group = np.unique(code, return_index=True, return_inverse=True)
        self.count, self.rows = len(first), len(code)
        self.trains = masks[: len(folds), first]
        tests = masks[len(folds) :, first]
        self.tested_by = np.where(tests.any(axis=0), tests.argmax(axis=0), -1)
        cuts = np.union1d(
            np.flatnonzero(np.diff(group, prepend=-1)), np.arange(0, self.rows, CHUNK_ROWS)
        )
        self.slices = [
            (slice(int(a), int(b)), int(group[a]))
            for a, b in zip(cuts, [*cuts[1:], self.rows], strict=True)
        ]

    def sums(self, columns: np.ndarray, residual: np.ndarray, delta: float) -> np.ndarray:
        """J'WJ and J'Wr of each group side by side (groups, p, p + 1), for columns J (n, p),
        residuals r (n,) and the weights W of Huber's loss.
        """
        p = columns.shape[1]
        out = np.zeros((self.count, p, p + 1))
        for rows, group in self.slices:
            both = np.empty((p + 1, rows.stop - rows.start))
            both[:p], both[p] = columns[rows].T, residual[rows]
            out[group] += (both[:p] * huber_weight(both[p], delta)) @ both.T
        return out

    def moved(self, residual: np.ndarray, columns: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Residuals (n,) to first order after the step (groups, p) of each row's group."""
        out = np.empty(self.rows)
        for rows, group in self.slices:
            np.add(residual[rows], columns[rows] @ steps[group], out=out[rows])
        return out

    @property
    def trained(self) -> np.ndarray:
        """Whether any fold trains on each group (groups,)."""
        return self.trains.any(axis=0)

    @property
    def leaves_out(self) -> np.ndarray:
        """Whether each fold (folds,) trains on fewer rows than all folds together."""
        return (self.trains != self.trained).any(axis=1)
