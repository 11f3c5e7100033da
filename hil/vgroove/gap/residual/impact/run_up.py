"""The rows before the impact cycle has settled, as means over short spans: at rest, in the spin-up
and over the first blows, which follow the start angle of the hammer.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.catalogue.statistics import RUN_UP, STATISTICS
from vgroove.gap.residual.immutable import freeze_arrays
from vgroove.gap.residual.impact.cycle_statistics import StatisticPart
from vgroove.gap.residual.impact.cycle_windows import RULES, CycleWindows
from vgroove.units import MINUTE_S

SPANS_OF_CYCLE = 2.0  # the first blows act within a part of a cycle
LONGEST_S = 0.3  # of spin-up and first blows; later ones hang too much on these to be predicted


@dataclass(frozen=True)
class RunUp:
    """Spans of `rows` rows, first rows (M,), and the columns whose means are judged; pulses: edges
    a turn of a Hall sensor (0: the speed is not made from edges).
    """

    first: np.ndarray
    rows: int
    row_s: float
    columns: tuple[str, ...]
    pulses: int

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def parts(self) -> tuple[StatisticPart, ...]:
        """The judged numbers of a span."""
        return tuple(
            StatisticPart(f"{c}.{RUN_UP}", STATISTICS[c].unit, c, RUN_UP) for c in self.columns
        )

    @property
    def centre(self) -> np.ndarray:
        """Row (M,) at the centre of each span."""
        return self.first + self.rows // 2

    @property
    def end_row(self) -> int:
        """Number of rows up to the end of the last span; 0: no spans."""
        return int(self.first[-1]) + self.rows if len(self.first) else 0

    def first_spans(self, count: int) -> "RunUp":
        """The run-up with its first `count` spans only."""
        return replace(self, first=self.first[:count])

    def means(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """Means (B, C, M) of columns (B, rows)."""
        place = self.first[:, None] + np.arange(self.rows)
        # contiguous spans: the order of a sum must not depend on the number of sets
        spans = [np.take(columns[c], place, axis=1) for c in self.columns]
        return np.stack([span.mean(axis=2) for span in spans], axis=1)

    def sigma(self, means: np.ndarray, noise: Mapping[str, float]) -> np.ndarray:
        """Standard deviations (C, M) of a log's means (C, M); infinite for a speed from edges that
        come more rarely than spans.
        """
        found = np.array([[noise[c]] for c in self.columns]) / np.sqrt(self.rows)
        found = np.broadcast_to(found, means.shape).copy()
        if self.pulses and "speed_rpm" in self.columns and len(self.first):
            k = self.columns.index("speed_rpm")
            found[k] = np.hypot(found[k], self._edge_sigma(means[k]))
        return found

    def _edge_sigma(self, speed_rpm: np.ndarray) -> np.ndarray:
        """What the unknown places of the edges leave open: a reading is the mean speed over a
        period that ended up to one period ago.
        """
        length_s = self.rows * self.row_s
        with np.errstate(divide="ignore", invalid="ignore"):
            period_s = MINUTE_S / (self.pulses * np.abs(speed_rpm))
            change = np.abs(np.gradient(speed_rpm)) / length_s * period_s
            found = change / np.sqrt(12.0 * np.maximum(1.0, length_s / period_s))
        frequent = period_s <= length_s
        frequent &= np.concatenate([[False], frequent[:-1]])
        return np.where(frequent, found, np.inf)


def run_up_spans(
    windows: CycleWindows, command: np.ndarray, columns: Sequence[str], pulses: int, at_rest: bool
) -> RunUp:
    """Spans from the log's first row to the first window with a cycle, or LONGEST_S after the first
    command; none where the log does not begin at rest: the model does.
    """
    rows = max(2, round(windows.rows / (RULES.cycles * SPANS_OF_CYCLE)))
    driven = int(np.argmax(command != 0.0))
    end = driven + round(LONGEST_S / windows.row_s)
    if windows.periodic.any():
        end = min(end, int(windows.first[np.argmax(windows.periodic)]))
    if driven == 0 or not at_rest:
        end = 0
    first = np.arange(0, end - rows + 1, rows)
    first = first if len(first) > 1 else first[:0]
    judged = tuple(c for c in columns if STATISTICS[c].run_up)
    return RunUp(first, rows, windows.row_s, judged, pulses)
