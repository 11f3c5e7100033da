"""Cuts a log into blocks and says which of them are predicted by fits that did not see them."""

from dataclasses import dataclass

import numpy as np

LONGEST_BLOCK_S = 1.0
SHORT_LOG_S = 10.0
FOLDS = 4
HELD_OUT = 3  # of every four blocks, counted from 1


@dataclass(frozen=True)
class Blocks:
    """Blocks of one log: edges_s (k+1,) their borders; folds: their number; rotate: every block is
    judged once, by a fit to the others.
    """

    edges_s: np.ndarray
    folds: int
    rotate: bool

    def of(self, time_s: np.ndarray) -> np.ndarray:
        """Number of the block, counted from 1, that each time lies in."""
        last = len(self.edges_s) - 1
        return np.clip(np.searchsorted(self.edges_s, time_s, side="left"), 1, last)

    def fold_of(self, block: np.ndarray) -> np.ndarray:
        """Fold 0..folds-1 that tests each block."""
        return (block - HELD_OUT) % self.folds

    def judged(self, block: np.ndarray) -> np.ndarray:
        """Whether each block's samples count in the gap."""
        return np.ones(len(block), dtype=bool) if self.rotate else self.fold_of(block) == 0

    def stretches(self) -> list[list[float]]:
        """Judged stretches [from, to] in seconds, neighbours joined."""
        number = np.arange(1, len(self.edges_s))
        found: list[list[float]] = []
        for k in number[self.judged(number)]:
            start, end = float(self.edges_s[k - 1]), float(self.edges_s[k])
            if found and found[-1][1] == start:
                found[-1][1] = end
            else:
                found.append([start, end])
        return found


def stroke_s(time_s: np.ndarray, speed: np.ndarray) -> float:
    """Mean time between reversals of a signed speed; the log's length when it never reverses. Below
    2 % of the top a speed has no sign.
    """
    known = np.isfinite(speed)
    top = np.max(np.abs(speed[known]), initial=0.0)
    moving = known & (np.abs(speed) > 0.02 * top)
    length = float(time_s[-1] - time_s[0])
    if top == 0.0 or not moving.any():
        return length
    return length / (1 + int(np.count_nonzero(np.diff(np.sign(speed[moving])))))


def cut(time_s: np.ndarray, stroke: float) -> Blocks:
    """Blocks of a log whose motion keeps one direction for `stroke` seconds.

    1 s, or an eighth of a shorter log; blocks 3, 7, 11, ... are held out, logs under 10 s rotate
    the four folds. Where a longer log goes to and fro in strokes longer than that, thirds take
    turns, so that both directions are in every fit.
    """
    start = float(time_s[0])
    length = float(time_s[-1]) - start
    if length >= SHORT_LOG_S and LONGEST_BLOCK_S < stroke < 0.5 * length:
        return Blocks(start + length * np.arange(4) / 3.0, 3, True)
    block = min(LONGEST_BLOCK_S, length / 8.0)
    count = max(1, round(length / block))
    return Blocks(start + length * np.arange(count + 1) / count, FOLDS, length < SHORT_LOG_S)
