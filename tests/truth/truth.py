"""Python interface of the generated tool (a shared library, by ctypes): runs for logs, and the
lock-step tool of the demo.
"""

import ctypes
import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
INSIDE = (
    "time_s",
    "current_a",
    "bus_v",
    "speed_rad_s",
    "angle_rad",
    "bristle_rad",
    "friction_nm",
    "stored_j",
    "drawn_j",
    "copper_j",
    "friction_j",
    "load_j",
)
_DOUBLES = ctypes.POINTER(ctypes.c_double)


class _Command(ctypes.Structure):
    _fields_ = [
        ("time_s", _DOUBLES),
        ("duty", _DOUBLES),
        ("coast", _DOUBLES),
        ("count", ctypes.c_int),
        ("load_time_s", _DOUBLES),
        ("load_nm", _DOUBLES),
        ("load_count", ctypes.c_int),
        ("bus_time_s", _DOUBLES),
        ("bus_v", _DOUBLES),
        ("bus_count", ctypes.c_int),
        ("extra_time_s", _DOUBLES),
        ("extra_supply_v", _DOUBLES),
        ("extra_coulomb_nm", _DOUBLES),
        ("extra_count", ctypes.c_int),
        ("rough_nm", _DOUBLES),
        ("rough_count", ctypes.c_int),
        ("rough_step_rad", ctypes.c_double),
    ]


class _Period(ctypes.Structure):
    _fields_ = [
        ("current_a", ctypes.c_double),
        ("supply_v", ctypes.c_double),
        ("edge_count", ctypes.c_int32),
        ("edge_cycle", ctypes.c_int32 * 8),
    ]


@dataclass(frozen=True)
class Command:
    """Bridge command and load over time, linear between points; a step is two points at one time.

    `coast` and `bus_v` hold from each of their points on; a bus that is given replaces the source.
    Disturbances, absent where empty: `extra_supply_v` and `extra_coulomb_nm` over `extra_time_s`
    are added to the open-circuit voltage and to the Coulomb friction; `rough_nm` is a torque
    against the motor at steps of `rough_step_rad` of its angle, periodic.
    """

    time_s: np.ndarray
    duty: np.ndarray
    coast: np.ndarray
    load_time_s: np.ndarray
    load_nm: np.ndarray
    bus_time_s: np.ndarray = field(default_factory=lambda: np.zeros(0))
    bus_v: np.ndarray = field(default_factory=lambda: np.zeros(0))
    extra_time_s: np.ndarray = field(default_factory=lambda: np.zeros(0))
    extra_supply_v: np.ndarray = field(default_factory=lambda: np.zeros(0))
    extra_coulomb_nm: np.ndarray = field(default_factory=lambda: np.zeros(0))
    rough_nm: np.ndarray = field(default_factory=lambda: np.zeros(0))
    rough_step_rad: float = 1.0


@dataclass(frozen=True)
class Run:
    """Result of a run: for each row (n,) means and end values without noise, and the Hall edges
    (m,).
    """

    begin_s: float
    time_s: np.ndarray
    current_a: np.ndarray
    supply_v: np.ndarray
    speed_rad_s: np.ndarray
    angle_rad: np.ndarray
    winding_kelvin: np.ndarray
    edge_s: np.ndarray
    edge_direction: np.ndarray


def library_path() -> Path:
    """The shared library: VGROOVE_TRUTH_LIB, or the newest one under build/*/truth/ without
    sanitizers.

    Raises FileNotFoundError with the command that builds it.
    """
    named = os.environ.get("VGROOVE_TRUTH_LIB")
    if named:
        return Path(named)
    built = [
        path for path in ROOT.glob("build/*/truth/libvgroove_truth.so") if "asan" not in path.parts
    ]
    found = sorted(built, key=lambda path: path.stat().st_mtime)
    if not found:
        raise FileNotFoundError(
            "libvgroove_truth.so is not built: "
            "cmake -S tests/truth -B build/truth && cmake --build build/truth"
        )
    return found[-1]


def _load() -> ctypes.CDLL:
    lib = ctypes.CDLL(str(library_path()))
    lib.truth_new.restype = ctypes.c_void_p
    lib.truth_get.restype = ctypes.c_double
    lib.truth_set.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_double]
    lib.truth_get.argtypes = [ctypes.c_void_p, ctypes.c_char_p]
    for name in ("truth_free", "truth_start"):
        getattr(lib, name).argtypes = [ctypes.c_void_p]
    lib.truth_run.argtypes = [
        ctypes.c_void_p,
        ctypes.POINTER(_Command),
        ctypes.c_double,
        _DOUBLES,
        ctypes.c_int,
        _DOUBLES,
    ]
    lib.truth_edges.argtypes = [ctypes.c_void_p, _DOUBLES, _DOUBLES]
    lib.truth_inside.argtypes = [ctypes.c_void_p, _DOUBLES]
    lib.truth_period.argtypes = [
        ctypes.c_void_p,
        ctypes.c_int,
        ctypes.c_double,
        ctypes.c_double,
        ctypes.c_double,
        ctypes.POINTER(_Period),
    ]
    lib.truth_period.restype = None
    return lib


def _pointer(array: np.ndarray) -> "ctypes._Pointer":
    return array.ctypes.data_as(_DOUBLES)


def _message(command: Command) -> tuple[_Command, dict[str, np.ndarray]]:
    """The command as the library takes it, and the arrays that it points to."""
    names = [name for name, kind in _Command._fields_ if kind is _DOUBLES]
    arrays = {n: np.ascontiguousarray(getattr(command, n), dtype=float) for n in names}
    counts = {
        "count": "time_s",
        "load_count": "load_time_s",
        "bus_count": "bus_time_s",
        "extra_count": "extra_time_s",
        "rough_count": "rough_nm",
    }
    pointers = {name: _pointer(array) for name, array in arrays.items()}
    lengths = {name: len(arrays[of]) for name, of in counts.items()}
    return _Command(**pointers, **lengths, rough_step_rad=command.rough_step_rad), arrays


class Generator:
    """One tool of the generator: named parameters in SI units (params.hpp), runs, and its
    states.
    """

    _lib: ctypes.CDLL | None = None

    def __init__(self, **params: float) -> None:
        if Generator._lib is None:
            Generator._lib = _load()
        self._tool = ctypes.c_void_p(Generator._lib.truth_new())
        self.set(**params)

    def __del__(self) -> None:
        if getattr(self, "_tool", None) and Generator._lib is not None:
            Generator._lib.truth_free(self._tool)

    def set(self, **params: float) -> None:
        """Set parameters; KeyError for one that does not exist."""
        for name, value in params.items():
            if Generator._lib.truth_set(self._tool, name.encode(), float(value)) != 0:
                raise KeyError(f"the generator has no parameter {name}")

    def get(self, name: str) -> float:
        return Generator._lib.truth_get(self._tool, name.encode())

    def start(self) -> None:
        """Return to rest at time 0, with the parameters unchanged."""
        Generator._lib.truth_start(self._tool)

    def inside(self) -> dict[str, float]:
        """States, and the energies drawn, lost and stored since the start, by name (INSIDE)."""
        out = np.zeros(len(INSIDE))
        Generator._lib.truth_inside(self._tool, _pointer(out))
        return dict(zip(INSIDE, out.tolist(), strict=True))

    def run(self, command: Command, row_s: np.ndarray, begin_s: float = 0.0) -> Run:
        """Run from rest; rows end at `row_s` (n,), the first begins at `begin_s`.

        Raises ArithmeticError where the integration diverges.
        """
        rows = np.ascontiguousarray(row_s, dtype=float)
        message, _arrays = _message(command)
        out = np.zeros((len(rows), 5))
        count = Generator._lib.truth_run(
            self._tool, ctypes.byref(message), begin_s, _pointer(rows), len(rows), _pointer(out)
        )
        if count < 0:
            raise ArithmeticError("the generator diverged: parameters too stiff for its step")
        edges = np.zeros((2, count))
        Generator._lib.truth_edges(self._tool, _pointer(edges[0]), _pointer(edges[1]))
        order = np.argsort(edges[0], kind="stable")
        return Run(begin_s, rows, *out.T.copy(), edges[0][order], edges[1][order])


class TruthTool(Generator):
    """The tool in lock-step with the board: one call is 510 cycles of 16 MHz, the unit of
    docs/architecture.md.
    """

    def __init__(self, **params: float) -> None:
        super().__init__(**params)
        self.start()
        self._answer = _Period()
        self._reference = ctypes.byref(self._answer)
        self._call = Generator._lib.truth_period

    def period(
        self, coast: int, duty: float, dead: float, load_nm: float = 0.0
    ) -> tuple[float, float, list[int]]:
        """(current in A at the end of the period, supply in V, Hall edges as cycles 0..509), with
        the noise of the sensors.
        """
        answer = self._answer
        self._call(self._tool, coast, duty, dead, load_nm, self._reference)
        return answer.current_a, answer.supply_v, answer.edge_cycle[: answer.edge_count]
