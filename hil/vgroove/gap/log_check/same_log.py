"""Refuses a log that is given twice, whatever its name: a second copy is no new information, but it
would narrow all intervals.
"""

import hashlib
from collections.abc import Sequence

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log import COLUMN_UNITS, Log


def refuse_same_log(logs: Sequence[Log]) -> None:
    """VgrooveError where two logs hold the same samples."""
    seen: dict[bytes, str] = {}
    for log in logs if len(logs) > 1 else ():
        content = content_hash(log)
        if content in seen:
            raise VgrooveError(
                f"{log.source}: holds the same samples as {seen[content]}: give each log once"
            )
        seen[content] = log.source


def content_hash(log: Log) -> bytes:
    """SHA-256 of the known columns by name; times count from the first row and are rounded to
    1 us, so that a copy with shifted stamps has the same hash.
    """
    digest = hashlib.sha256()
    time_s = np.asarray(log.time_s, float)
    digest.update(np.round((time_s - time_s[0]) * 1e6).tobytes())
    for name in sorted(set(log.columns) & set(COLUMN_UNITS)):
        values = np.asarray(log.columns[name], float) + 0.0  # -0.0 and 0.0 are one value
        digest.update(name.encode() + np.where(np.isnan(values), np.nan, values).tobytes())
    return digest.digest()
