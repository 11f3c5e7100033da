"""Python interface of the generated impact tool (a shared library, by ctypes): runs for logs."""

import ctypes
from dataclasses import dataclass

import numpy as np
from truth import _DOUBLES, Command, Run, _Period, _pointer, library_path

INSIDE = (
    "time_s",
    "speed_rad_s",
    "stored_j",
    "input_j",
    "lost_j",
    "steps",
    "twist_rad",
    "travel_m",
)
MOST_BLOWS = 4000


class _ImpactRun(ctypes.Structure):
    _fields_ = [
        ("time_s", _DOUBLES),
        ("duty", _DOUBLES),
        ("coast", _DOUBLES),
        ("count", ctypes.c_int),
        ("forward_nm", _DOUBLES),
        ("backward_nm", _DOUBLES),
        ("slip_count", ctypes.c_int),
        ("slip_first_rad", ctypes.c_double),
        ("slip_step_rad", ctypes.c_double),
    ]


@dataclass(frozen=True)
class SlipTorque:
    """Slip torques of a joint (n,) in N m, forwards and backwards, at head angles from `first_rad`
    on at steps of `step_rad`; linear between them, constant beyond.
    """

    forward_nm: np.ndarray
    backward_nm: np.ndarray
    first_rad: float
    step_rad: float


@dataclass(frozen=True)
class ImpactRun:
    """Result of a run: `run` as of a tool without mechanism (the motor's side), the bench channels
    (n,) at the ends of the rows, and the blows (m,).

    A blow is the first touch of a lug: time, speed of approach, largest joint torque until the next
    blow, and head angle.
    """

    run: Run
    anvil_torque_nm: np.ndarray
    anvil_angle_rad: np.ndarray
    hammer_mm: np.ndarray
    blow_s: np.ndarray
    approach_rad_s: np.ndarray
    peak_nm: np.ndarray
    head_rad: np.ndarray


def _load() -> ctypes.CDLL:
    lib = ctypes.CDLL(str(library_path()))
    lib.truth_impact_new.restype = ctypes.c_void_p
    lib.truth_impact_get.restype = ctypes.c_double
    lib.truth_impact_set.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_double]
    lib.truth_impact_get.argtypes = [ctypes.c_void_p, ctypes.c_char_p]
    lib.truth_impact_free.argtypes = [ctypes.c_void_p]
    lib.truth_impact_run.argtypes = [
        ctypes.c_void_p,
        ctypes.POINTER(_ImpactRun),
        _DOUBLES,
        ctypes.c_int,
        _DOUBLES,
    ]
    lib.truth_impact_edges.argtypes = [ctypes.c_void_p, _DOUBLES, _DOUBLES]
    lib.truth_impact_blows.argtypes = [ctypes.c_void_p, _DOUBLES, ctypes.c_int]
    lib.truth_impact_begin.argtypes = [ctypes.c_void_p, ctypes.POINTER(_ImpactRun)]
    lib.truth_impact_period.argtypes = [
        ctypes.c_void_p,
        ctypes.c_int,
        ctypes.c_double,
        ctypes.c_double,
        ctypes.POINTER(_Period),
    ]
    lib.truth_impact_period.restype = None
    lib.truth_impact_inside.argtypes = [ctypes.c_void_p, _DOUBLES]
    return lib


class ImpactGenerator:
    """One impact tool of the generator: named parameters in SI units (impact.hpp), and runs."""

    _lib: ctypes.CDLL | None = None

    def __init__(self, **params: float) -> None:
        if ImpactGenerator._lib is None:
            ImpactGenerator._lib = _load()
        self._tool = ctypes.c_void_p(ImpactGenerator._lib.truth_impact_new())
        self._arrays: list[np.ndarray] = []
        self.set(**params)

    def __del__(self) -> None:
        if getattr(self, "_tool", None) and ImpactGenerator._lib is not None:
            ImpactGenerator._lib.truth_impact_free(self._tool)

    def set(self, **params: float) -> None:
        """Set parameters; KeyError for one that does not exist."""
        for name, value in params.items():
            if ImpactGenerator._lib.truth_impact_set(self._tool, name.encode(), float(value)) != 0:
                raise KeyError(f"the impact tool has no parameter {name}")

    def get(self, name: str) -> float:
        return ImpactGenerator._lib.truth_impact_get(self._tool, name.encode())

    def inside(self) -> dict[str, float]:
        """Stored energy, energies put in and lost since the start, and other states, by name."""
        out = np.zeros(len(INSIDE))
        ImpactGenerator._lib.truth_impact_inside(self._tool, _pointer(out))
        return dict(zip(INSIDE, out.tolist(), strict=True))

    def run(self, command: Command, slip: SlipTorque, row_s: np.ndarray) -> ImpactRun:
        """Run from rest; rows end at `row_s` (n,), the first begins at 0.

        Raises ArithmeticError where the integration diverges.
        """
        rows = np.ascontiguousarray(row_s, dtype=float)
        out = np.zeros((len(rows), 8))
        message = self._message(command, slip)
        lib = ImpactGenerator._lib
        count = lib.truth_impact_run(
            self._tool, ctypes.byref(message), _pointer(rows), len(rows), _pointer(out)
        )
        if count < 0:
            raise ArithmeticError("the impact tool diverged")
        edges, blows = np.zeros((2, count)), np.zeros((MOST_BLOWS, 6))
        lib.truth_impact_edges(self._tool, _pointer(edges[0]), _pointer(edges[1]))
        struck = min(lib.truth_impact_blows(self._tool, _pointer(blows), MOST_BLOWS), MOST_BLOWS)
        order = np.argsort(edges[0], kind="stable")
        run = Run(0.0, rows, *out.T[:5].copy(), edges[0][order], edges[1][order])
        # of a blow the library also writes the number of the gap (1) and the motor angle (5)
        struck_blows = blows[:struck, [0, 2, 3, 4]].T.copy()
        return ImpactRun(run, out[:, 5], out[:, 6], out[:, 7] * 1e3, *struck_blows)

    def _message(self, command: Command | None, slip: SlipTorque) -> _ImpactRun:
        """Command and joint as the library takes them; the arrays are kept, since it keeps their
        addresses.
        """
        named = {"time_s": command, "duty": command, "coast": command} if command else {}
        named |= {"forward_nm": slip, "backward_nm": slip}
        arrays = {
            name: np.ascontiguousarray(getattr(of, name), dtype=float) for name, of in named.items()
        }
        self._arrays = list(arrays.values())
        return _ImpactRun(
            **{name: _pointer(array) for name, array in arrays.items()},
            count=len(arrays["time_s"]) if command else 0,
            slip_count=len(arrays["forward_nm"]),
            slip_first_rad=slip.first_rad,
            slip_step_rad=slip.step_rad,
        )


class ImpactTruthTool(ImpactGenerator):
    """The impact tool in lock-step with the board, as truth.TruthTool: one call is 510 cycles of
    16 MHz.
    """

    def __init__(self, slip: SlipTorque, **params: float) -> None:
        super().__init__(**params)
        lib = ImpactGenerator._lib
        lib.truth_impact_begin(self._tool, ctypes.byref(self._message(None, slip)))
        self._answer = _Period()
        self._reference = ctypes.byref(self._answer)
        self._call = lib.truth_impact_period

    def period(
        self, coast: int, duty: float, dead: float, load_nm: float = 0.0
    ) -> tuple[float, float, list[int]]:
        """(current in A at the end of the period, mean supply in V, Hall edges as cycles 0..509),
        with the noise of the sensors; the load is the tool's joint.
        """
        answer = self._answer
        self._call(self._tool, coast, duty, dead, self._reference)
        return answer.current_a, answer.supply_v, answer.edge_cycle[: answer.edge_count]

    def blows(self) -> np.ndarray:
        """The blows (m, 6) since the start, the columns as in ImpactRun from blow_s on."""
        out = np.zeros((MOST_BLOWS, 6))
        count = ImpactGenerator._lib.truth_impact_blows(self._tool, _pointer(out), MOST_BLOWS)
        return out[: min(count, MOST_BLOWS)]
