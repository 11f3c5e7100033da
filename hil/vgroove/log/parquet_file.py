"""Parquet logs: a column of the file is a column of the log."""

from pathlib import Path
from typing import Any

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log.column_map import NO_MAP, ColumnMap
from vgroove.log.extras import need
from vgroove.log.raw_columns import RawColumns, log_from_raw
from vgroove.log.table import Log


def read_parquet(path: Path, columns: ColumnMap = NO_MAP) -> Log:
    """Read a Parquet file; VgrooveError for a damaged one, and without pyarrow."""
    parquet = need("pyarrow.parquet", f"{path}: a Parquet file")
    try:
        names = parquet.read_schema(path).names
        twice = sorted({name for name in names if names.count(name) > 1})
        table = None if twice else parquet.read_table(path)
    except OSError:
        raise
    except Exception as error:
        raise VgrooveError(f"{path}: is a damaged or truncated Parquet file: {error}.") from error
    if table is None:
        raise VgrooveError(f"{path}: has the column {', '.join(twice)} twice: rename one of them")

    def values(name: str) -> Any:
        column = table.column(name).to_numpy()
        return np.asarray(column)

    return log_from_raw(RawColumns(str(path), table.column_names, values), columns)
