"""Chooses the rows of a log within a range of its own time column."""

import math
from dataclasses import dataclass, replace

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log import MIN_USABLE_SAMPLES, Log


@dataclass(frozen=True)
class TimeRange:
    """Times in s of a log's own column, both included; None: from its first or to its last row.
    VgrooveError for an empty range, or an end that is no number.
    """

    from_s: float | None = None
    to_s: float | None = None

    def __post_init__(self) -> None:
        if any(end is not None and math.isnan(end) for end in (self.from_s, self.to_s)):
            raise VgrooveError("--from and --to are times in s, not nan")
        if self.from_s is not None and self.to_s is not None and not self.from_s < self.to_s:
            raise VgrooveError(
                f"the range from {self.from_s:.10g} s to {self.to_s:.10g} s is empty: --from must "
                "be below --to"
            )

    def select(self, log: Log) -> Log:
        """The rows of a log within the range, the log itself without one; VgrooveError where too
        few are left.
        """
        if self.from_s is None and self.to_s is None:
            return log
        time_s = np.asarray(log.time_s, dtype=float)
        first = 0 if self.from_s is None else int(np.searchsorted(time_s, self.from_s))
        end = len(time_s)
        if self.to_s is not None:
            end = int(np.searchsorted(time_s, self.to_s, side="right"))
        if end - first < MIN_USABLE_SAMPLES:
            raise VgrooveError(
                f"{log.source}: {max(0, end - first)} rows lie between --from and --to, at least "
                f"{MIN_USABLE_SAMPLES} are needed: the log goes from {time_s[0]:.10g} s to "
                f"{time_s[-1]:.10g} s"
            )
        # copies: a view would keep the whole log in memory
        columns = {name: np.array(values[first:end]) for name, values in log.columns.items()}
        return replace(log, time_s=time_s[first:end].copy(), columns=columns)
