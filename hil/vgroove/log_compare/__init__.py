"""Comparison of two logs: where they first differ, the gap of each column, and what explains it:
resolution, timing, or neither (`vgroove log compare`, docs/log_compare.md).
"""

from vgroove.log_compare.compare import Comparison, compare_logs
from vgroove.log_compare.gaps import SignalGap
from vgroove.log_compare.limits import LIMITS, Limits
from vgroove.log_compare.time_map import TimeMap

__all__ = ["LIMITS", "Comparison", "Limits", "SignalGap", "TimeMap", "compare_logs"]
