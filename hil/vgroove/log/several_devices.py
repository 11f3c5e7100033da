"""Rows of several devices in one CSV file, which a column that names the device of a row shows, or
columns that all change more from a row to the next one than from each device's row to its next. The
motion must be among them: a command, and the current and the bus that follow it, may alternate from
row to row, a speed or an angle of one shaft may not.
"""

from itertools import islice

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log.csv_cells import Table
from vgroove.log.units_of_columns import TIME_COLUMN

PROBED_ROWS = 200  # in which a column that names devices has each name
MAX_DEVICES = 16
# least ratio of the mean change from a row to the next one, of another device, to that from a row
# to the next one of its own device, which for rows of one device is below 1 (value chosen)
MIN_RATIO = 4.0
ORDINALS = {2: "second", 3: "third", 4: "fourth"}  # of numbers of devices that no column names
MIN_ROWS = 50  # below which chance may divide the rows
MIN_COLUMNS = 2  # that change in turns: one may for another reason
MOTION = ("speed_rpm", "position_rad", "anvil_angle_rad", "hammer_mm")  # states of a tool


def refuse_several_devices(
    table: Table, columns: dict[int, np.ndarray], names: dict[int, str]
) -> None:
    """VgrooveError where a column of the file that is no log column divides the rows into those of
    several devices, or where all columns of the log show devices in turns. columns: those of the
    log (rows,) by their number in the file, names: their names in the log.
    """
    motion = [v for k, v in columns.items() if names[k] in MOTION and _changes(v)]
    if not motion or len(motion[0]) < MIN_ROWS:
        return
    values = [v for k, v in columns.items() if names[k] != TIME_COLUMN and _changes(v)]
    header = table.dialect.header
    for k in (k for k in range(len(header)) if k not in columns):
        if not _is_in_turns(list(islice(table.cells(k), PROBED_ROWS))):
            continue
        cells = np.array(list(table.cells(k)))
        if len(cells) != len(values[0]):
            continue
        devices = np.unique(cells)
        if len(devices) <= MAX_DEVICES and _are_apart(motion, cells, devices):
            raise VgrooveError(
                f"{table.path}: column {header[k] or k + 1}: its values "
                f"{', '.join(map(repr, devices.tolist()))} divide the rows into those of several "
                "devices: write the rows of each as a log of its own (or leave this column out, "
                "if they are those of one)."
            )
    for count in ORDINALS if len(values) >= MIN_COLUMNS else ():
        if _are_apart(values, np.arange(len(values[0])) % count, np.arange(count)):
            raise VgrooveError(
                f"{table.path}: all columns change less from a row to the {ORDINALS[count]} one "
                "after it than to the next one: these are rows of several devices: write the rows "
                "of each as a log of its own."
            )


def _changes(column: np.ndarray) -> bool:
    """Whether a column (rows,) is not constant."""
    return bool(np.nanmax(column, initial=-np.inf) > np.nanmin(column, initial=np.inf))


def _are_apart(columns: list[np.ndarray], cells: np.ndarray, devices: np.ndarray) -> bool:
    """Whether the cells (rows,) name the devices (k,) of the rows, by all columns (rows,)."""
    return all(_ratio(column, cells, devices) >= MIN_RATIO for column in columns)


def _is_in_turns(cells: list[str]) -> bool:
    """Whether cells hold few values, each more than once, and change in a quarter of the rows or
    more.
    """
    changes = sum(a != b for a, b in zip(cells, cells[1:], strict=False))
    return 2 <= len(set(cells)) <= min(MAX_DEVICES, len(cells) // 2) and 4 * changes >= len(cells)


def _ratio(column: np.ndarray, cells: np.ndarray, devices: np.ndarray) -> float:
    """Mean change of a column (rows,) from a row to the next one where the cells (rows,) differ,
    over that from a row to the next one with the same cell, which lies further off; 0 for a
    constant column.
    """
    other = np.abs(np.diff(column))[cells[1:] != cells[:-1]]
    own = np.concatenate([np.abs(np.diff(column[cells == name])) for name in devices])
    if not np.isfinite(other).any() or not np.isfinite(own).any():
        return 0.0
    change, own_change = float(np.nanmean(other)), float(np.nanmean(own))
    if own_change == 0.0:
        return np.inf if change > 0.0 else 0.0
    return change / own_change
