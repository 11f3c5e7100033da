"""Rows of several devices in one CSV file, which a column that names the device of a row shows, or
columns that all change more from a row to the next one than from each device's row to its next.
"""

from itertools import islice

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log.csv_cells import Table

PROBED_ROWS = 200  # in which a column that names devices has each name
MAX_DEVICES = 16
# least ratio of the mean change from a row to the next one, of another device, to that from a row
# to the next one of its own device, which for rows of one device is below 1 (value chosen)
MIN_RATIO = 4.0
ORDINALS = {2: "second", 3: "third", 4: "fourth"}  # of numbers of devices that no column names
MIN_COLUMNS = 2  # that have this ratio: one may be written in turns for another reason


def refuse_several_devices(table: Table, columns: dict[int, np.ndarray], time: int) -> None:
    """VgrooveError where a column of the file that is no log column divides the rows into those of
    several devices, or where all columns of the log show devices in turns. columns: those of the
    log (rows,) by number, of which `time` holds the times.
    """
    values = [column for k, column in columns.items() if k != time]
    header = table.dialect.header
    for k in (k for k in range(len(header)) if k not in columns):
        if not _is_in_turns(list(islice(table.cells(k), PROBED_ROWS))):
            continue
        cells = np.array(list(table.cells(k)))
        if len(cells) != len(values[0]):
            continue
        names = np.unique(cells)
        apart = sum(_ratio(column, cells, names) >= MIN_RATIO for column in values)
        if len(names) <= MAX_DEVICES and apart >= min(MIN_COLUMNS, len(values)):
            raise VgrooveError(
                f"{table.path}: column {header[k] or k + 1}: its values "
                f"{', '.join(map(repr, names.tolist()))} divide the rows into those of several "
                "devices: write the rows of each as a log of its own (or leave this column out, "
                "if they are those of one)."
            )
    for count in ORDINALS:
        if _take_turns(values, count):
            raise VgrooveError(
                f"{table.path}: all columns change less from a row to the {ORDINALS[count]} one "
                "after it than to the next one: these are rows of several devices: write the rows "
                "of each as a log of its own."
            )


def _take_turns(values: list[np.ndarray], count: int) -> bool:
    """Whether `count` devices take turns in the rows of all columns (rows,) that change."""
    cells = np.arange(len(values[0])) % count
    names = np.arange(count)
    changing = [v for v in values if np.nanmax(v, initial=-np.inf) > np.nanmin(v, initial=np.inf)]
    apart = [_ratio(column, cells, names) >= MIN_RATIO for column in changing]
    return len(apart) >= MIN_COLUMNS and all(apart)


def _is_in_turns(cells: list[str]) -> bool:
    """Whether cells hold few values, each more than once, and change in a quarter of the rows or
    more.
    """
    changes = sum(a != b for a, b in zip(cells, cells[1:], strict=False))
    return 2 <= len(set(cells)) <= min(MAX_DEVICES, len(cells) // 2) and 4 * changes >= len(cells)


def _ratio(column: np.ndarray, cells: np.ndarray, names: np.ndarray) -> float:
    """Mean change of a column (rows,) from a row to the next one where the cells (rows,) differ,
    over that from a row to the next one with the same cell, which lies further off; 0 for a
    constant column.
    """
    other = np.abs(np.diff(column))[cells[1:] != cells[:-1]]
    own = np.concatenate([np.abs(np.diff(column[cells == name])) for name in names])
    if not np.isfinite(other).any() or not np.isfinite(own).any():
        return 0.0
    change, own_change = float(np.nanmean(other)), float(np.nanmean(own))
    if own_change == 0.0:
        return np.inf if change > 0.0 else 0.0
    return change / own_change
