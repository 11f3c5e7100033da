"""MAT logs: variables of MATLAB, or fields of a struct, that are vectors, and what the blocks To
Workspace and Scope of Simulink save as "Structure With Time"; versions 5 to 7 by scipy, version 7.3
(HDF5) by h5py.
"""

from pathlib import Path
from typing import Any

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.log.column_map import NO_MAP, ColumnMap
from vgroove.log.extras import need
from vgroove.log.raw_columns import RawColumns, log_from_raw
from vgroove.log.table import Log

MAX_COLUMNS = 64  # of a matrix, each of which is read as a column of its own
VERSION_7_3 = b"MATLAB 7.3"


def read_mat(path: Path, columns: ColumnMap = NO_MAP) -> Log:
    """Read a MAT file; a field of a struct is named struct.field, or field where no other variable
    has this name. VgrooveError for a damaged file.
    """
    with path.open("rb") as file:
        is_hdf5 = file.read(len(VERSION_7_3)) == VERSION_7_3
    try:
        found = _hdf5_vectors(path) if is_hdf5 else _vectors(path)
    except (VgrooveError, MemoryError):
        raise
    except Exception as error:
        raise VgrooveError(
            f"{path}: is a damaged or truncated MAT file: {error or type(error).__name__}."
        ) from error
    found = _short_names(found)
    if not found:
        raise VgrooveError(
            f"{path}: holds no vector of numbers (tables and timeseries of MATLAB "
            "are objects: save their columns as vectors or in a struct)."
        )
    return log_from_raw(RawColumns(str(path), list(found), found.__getitem__), columns)


def _vectors(path: Path) -> dict[str, np.ndarray]:
    from scipy.io import loadmat

    found: dict[str, np.ndarray] = {}
    for name, value in loadmat(path, squeeze_me=True, chars_as_strings=True).items():
        if not name.startswith("__"):
            _collect(name, value, found)
    return found


def _collect(name: str, value: Any, found: dict[str, np.ndarray]) -> None:
    """Add the vectors of a variable, of the fields of a struct, of the columns of a matrix."""
    array = np.asarray(value)
    signals = _signals_of_simulink(array)
    if signals is not None:
        _collect(f"{name}.time", array["time"].item(), found)
        _collect_signals(name, signals, found)
    elif array.dtype.names and array.size == 1:
        for field in array.dtype.names:
            _collect(f"{name}.{field}", array[field].item(), found)
    elif array.dtype.kind in "biuf" and array.size > 1:
        _add(name, array.squeeze(), found)


def _signals_of_simulink(array: np.ndarray) -> np.ndarray | None:
    """The signals of a "Structure With Time"; None for any other value."""
    if array.size != 1 or not {"time", "signals"} <= set(array.dtype.names or ()):
        return None
    signals = np.atleast_1d(array["signals"].item())
    return signals if "values" in (signals.dtype.names or ()) else None


def _collect_signals(name: str, signals: np.ndarray, found: dict[str, np.ndarray]) -> None:
    """Add the values of the signals of a "Structure With Time": a struct array with the fields
    values, label and blockName. A signal without label has the name of its block, or its number;
    its number is added to a name that another one has.
    """
    for number, signal in enumerate(signals, 1):
        fields = signal.dtype.names or ()
        # scipy reads an empty text as an empty array
        texts = [signal[f] for f in ("label", "blockName") if f in fields and np.size(signal[f])]
        label = next((str(text) for text in texts if str(text)), f"signal_{number}")
        full = f"{name}.{label.rpartition('/')[2]}"
        taken = any(other == full or other.startswith(f"{full}_") for other in found)
        _collect(f"{full}_{number}" if taken else full, signal["values"], found)


def _add(name: str, array: np.ndarray, found: dict[str, np.ndarray]) -> None:
    if array.ndim == 1:
        found[name] = array
    elif array.ndim == 2:
        array = array if array.shape[0] >= array.shape[1] else array.T
        if array.shape[1] <= MAX_COLUMNS:
            found.update({f"{name}_{k}": column for k, column in enumerate(array.T, 1)})


def _hdf5_vectors(path: Path) -> dict[str, np.ndarray]:
    h5py = need("h5py", f"{path}: a MAT file of version 7.3")
    found: dict[str, np.ndarray] = {}

    def visit(name: str, item: Any) -> None:
        numbers = isinstance(item, h5py.Dataset) and item.dtype.kind in "biuf"
        is_text = item.attrs.get("MATLAB_class") == b"char"
        if numbers and item.size > 1 and not is_text and not name.startswith("#"):
            _add(name.replace("/", "."), np.squeeze(item[()]), found)

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return found


def _short_names(found: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The vectors by the last part of their names, where no other one has it."""
    last = [name.rpartition(".")[2] for name in found]
    return {
        short if last.count(short) == 1 else name: found[name]
        for name, short in zip(found, last, strict=True)
    }
