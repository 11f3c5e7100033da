"""Makes logs from what Python programs hold: a pandas or polars DataFrame, a dict of arrays, a
structured array, a Log. None of these libraries is imported.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log.column_map import NO_MAP, ColumnMap
from vgroove.log.raw_columns import RawColumns, log_from_raw
from vgroove.log.table import Log

SOURCE = "the table"


def is_log(item: Any) -> bool:
    """Whether an object has the attributes of a Log: times, and a dict of columns."""
    return isinstance(item, Log) or (
        hasattr(item, "time_s") and isinstance(getattr(item, "columns", None), Mapping)
    )


def as_log(item: Any, columns: ColumnMap = NO_MAP) -> Any:
    """A log from a path, a Log, a DataFrame, a dict of arrays or a structured array; the index of a
    DataFrame counts as a column where it has a name. VgrooveError for anything else.
    """
    if isinstance(item, str | Path):
        from vgroove.log import read_log

        return read_log(item, columns)
    if is_log(item):
        return item
    return log_from_raw(_raw(item), columns)


def as_list(items: Any) -> list[Any]:
    """A list of logs from one log or a sequence of them."""
    single = isinstance(items, str | Path | Mapping | np.ndarray) or is_log(items)
    if single or not isinstance(items, Sequence):
        return [items]
    return list(items)


def _raw(item: Any) -> RawColumns:
    """The named columns of a table."""
    if isinstance(item, Mapping):
        keys = {str(key): key for key in item}  # a number may be a name
        return RawColumns(SOURCE, list(keys), lambda name: item[keys[name]])
    if isinstance(item, np.ndarray) and item.dtype.names:
        return RawColumns(SOURCE, list(item.dtype.names), item.__getitem__)
    if not hasattr(item, "columns") or not hasattr(item, "__getitem__"):
        raise VgrooveError(
            f"a log is a path, a vgroove.log.Log, a DataFrame or a dict of arrays, not {item!r:.60}"
        )
    columns = {str(name): name for name in item.columns}
    index = getattr(getattr(item, "index", None), "name", None)
    if index is None or str(index) in columns:
        return RawColumns(SOURCE, list(columns), lambda name: item[columns[name]])
    return RawColumns(
        SOURCE,
        [str(index), *columns],
        lambda name: item.index if name == str(index) else item[columns[name]],
    )
