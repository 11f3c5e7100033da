"""Builds and runs the plain C++ semi-implicit Euler of euler.cpp."""

import ctypes
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt

from vgroove.bench.own import ROW_S

Floats = npt.NDArray[np.float64]

SOURCE = Path(__file__).with_name("euler.cpp")
FLAGS = ("-std=c++17", "-O3", "-march=native", "-shared", "-fPIC")


def compiler() -> str:
    """The C++ compiler: $CXX, c++ or g++; ImportError without one."""
    for name in (os.environ.get("CXX"), "c++", "g++"):
        if name and shutil.which(name):
            return name
    raise ImportError("no C++ compiler", name="c++")


def build() -> ctypes.CDLL:
    """The shared library, built in a temporary directory; ImportError where it does not build."""
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "euler.so"
        done = subprocess.run(
            [compiler(), *FLAGS, "-o", str(library), str(SOURCE)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise ImportError(f"euler.cpp does not build: {done.stderr.strip()}", name="c++")
        return ctypes.CDLL(str(library))


def run(library: ctypes.CDLL, y0: Floats, p: Floats, rows: int, step_s: float) -> Floats:
    """States (rows + 1, 8) at rows of 1 ms by steps of step_s, which divides 1 ms."""
    steps = round(ROW_S / step_s)
    out, state = np.empty((rows, y0.size)), y0.copy()
    arrays = [a.ctypes.data_as(ctypes.c_void_p) for a in (p, state, out)]
    counts = [ctypes.c_double(ROW_S / steps), ctypes.c_int64(rows), ctypes.c_int64(steps)]
    library.vgroove_euler(arrays[0], arrays[1], *counts, arrays[2])
    return np.vstack([y0[None, :], out])
