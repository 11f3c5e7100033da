"""Cuts a log into blocks for cross-validation: which fold tests each block, and which blocks count
in the reported gap.
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.residual.immutable import freeze_arrays

# docs/spec/gap.md, section 5: blocks of 1 s, or an eighth of a shorter log; of every four blocks,
# counted from 1, the third is held out; logs under 10 s rotate the four folds
MAX_BLOCK_S = 1.0
MIN_BLOCKS = 8
SHORT_LOG_S = 10.0
FOLDS = 4
HELD_OUT = 3
# a log whose strokes last longer than a block and less than MAX_STROKE_SHARE of the log is cut into
# thirds that rotate
STROKE_FOLDS = 3
MAX_STROKE_SHARE = 0.5
MOVING_SHARE = 0.02  # of the top speed: a lower speed counts as standstill


@dataclass(frozen=True)
class FoldBlocks:
    """Blocks of one log: borders_s (k + 1,) their borders in s; folds their number; rotate: every
    block counts, predicted by a fit to the others; in_use (k,): whether a block holds rows that can
    be judged (None: all do).
    """

    borders_s: np.ndarray
    folds: int
    rotate: bool
    in_use: np.ndarray | None = None

    def __post_init__(self) -> None:
        freeze_arrays(self)

    def of(self, time_s: np.ndarray) -> np.ndarray:
        """Number (m,) of the block, counted from 1, that each time lies in."""
        last = len(self.borders_s) - 1
        return np.clip(np.searchsorted(self.borders_s, time_s, side="left"), 1, last)

    def fold_of(self, block: np.ndarray) -> np.ndarray:
        """Fold 0..folds-1 that tests each block (m,)."""
        return (block - HELD_OUT) % self.folds

    def judged(self, block: np.ndarray) -> np.ndarray:
        """Whether the samples of each block (m,) count in the gap."""
        return np.ones(len(block), dtype=bool) if self.rotate else self.fold_of(block) == 0

    def limited_to(self, time_s: np.ndarray) -> "FoldBlocks":
        """The blocks, of which only those that hold one of the times (m,), s, are in use."""
        number = np.arange(1, len(self.borders_s))
        return replace(self, in_use=np.isin(number, self.of(time_s)))

    def stretches(self) -> list[list[float]]:
        """Judged stretches [from, to] in s, neighbours joined."""
        number = np.arange(1, len(self.borders_s))
        number = number if self.in_use is None else number[self.in_use]
        found: list[list[float]] = []
        for k in number[self.judged(number)]:
            start, end = float(self.borders_s[k - 1]), float(self.borders_s[k])
            if found and found[-1][1] == start:
                found[-1][1] = end
            else:
                found.append([start, end])
        return found


def mean_stroke_s(time_s: np.ndarray, speed: np.ndarray) -> float:
    """Mean time between reversals of a signed speed (rows,) in s; the log's length when it never
    reverses.
    """
    known = np.isfinite(speed)
    top = np.max(np.abs(speed[known]), initial=0.0)
    moving = known & (np.abs(speed) > MOVING_SHARE * top)
    length = float(time_s[-1] - time_s[0])
    if top == 0.0 or not moving.any():
        return length
    return length / (1 + int(np.count_nonzero(np.diff(np.sign(speed[moving])))))


def cut_blocks(time_s: np.ndarray, stroke: float) -> FoldBlocks:
    """Blocks of a log whose motion keeps one direction for `stroke` seconds on average. A long log
    of strokes to and fro that last longer than a block is cut into thirds that rotate, so that
    every fit has rows of both directions.
    """
    start = float(time_s[0])
    length = float(time_s[-1]) - start
    if length >= SHORT_LOG_S and MAX_BLOCK_S < stroke < MAX_STROKE_SHARE * length:
        edges = start + length * np.arange(STROKE_FOLDS + 1) / float(STROKE_FOLDS)
        return FoldBlocks(edges, STROKE_FOLDS, True)
    block = min(MAX_BLOCK_S, length / MIN_BLOCKS)
    count = max(1, round(length / block))
    edges = start + length * np.arange(count + 1) / count
    return FoldBlocks(edges, FOLDS, length < SHORT_LOG_S)
