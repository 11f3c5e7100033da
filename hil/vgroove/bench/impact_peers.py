"""The impact model for general-purpose solvers with one compiled right-hand side: numbalsoda,
scikit-sundae CVODE, SciPy LSODA.

Each returns the states at rows of 1 ms and has no event location. Method and absolute tolerance
(equal to the relative one, in A, rad and rad/s) are those with the best result of each peer.
"""

from collections.abc import Callable

import numba as nb
import numpy as np
import numpy.typing as npt
from scipy.integrate import odeint

from vgroove.bench.impact_model import derivative
from vgroove.bench.impact_tool import PARAMETER_COUNT, STATES

Floats = npt.NDArray[np.float64]
# times (n,), start (8,), parameters, tolerance -> states (n, 8)
Run = Callable[[Floats, Floats, Floats, float], Floats]
COUNT = len(STATES)
MAX_STEPS = 100_000  # between two rows


@nb.njit
def _rhs(_t: float, y: Floats, p: Floats) -> Floats:
    dy = np.empty(COUNT)
    derivative(y, dy, p)
    return dy


def scipy_lsoda(times: Floats, y0: Floats, p: Floats, rtol: float) -> Floats:
    """SciPy's odeint (LSODA)."""
    return odeint(_rhs, y0, times, args=(p,), rtol=rtol, atol=rtol, tfirst=True, mxstep=MAX_STEPS)


def reference(times: Floats, y0: Floats, p: Floats) -> Floats:
    """odeint at the tightest useful tolerance, with steps too short to miss a contact."""
    return odeint(
        _rhs, y0, times, args=(p,), rtol=1e-11, atol=1e-12, tfirst=True, mxstep=MAX_STEPS, hmax=1e-5
    )


def load_sundae() -> Run:
    """scikit-sundae's CVODE (Adams, since BDF is slower here and fails at some tolerances)."""
    from sksundae.cvode import CVODE

    def run(times: Floats, y0: Floats, p: Floats, rtol: float) -> Floats:
        solver = CVODE(
            lambda _t, y, dy: derivative(y, dy, p),
            method="Adams",
            rtol=rtol,
            atol=rtol,
            max_num_steps=MAX_STEPS,
        )
        solution = solver.solve(times, y0)
        return solution.y if solution.success else np.full((times.size, y0.size), np.nan)

    return run


class Numbalsoda:
    """numbalsoda's LSODA in one call, restarted every row as in lock-step with a controller, and as
    a batch on all threads.
    """

    def __init__(self) -> None:
        from numbalsoda import lsoda, lsoda_sig

        @nb.cfunc(lsoda_sig)
        def rhs(_t, u, du, p):  # noqa: ANN001, ANN202 (the signature is numbalsoda's)
            derivative(
                nb.carray(u, (COUNT,)), nb.carray(du, (COUNT,)), nb.carray(p, (PARAMETER_COUNT,))
            )

        self._rhs, self._lsoda = rhs, lsoda
        self.restarted = restarted_run(lsoda, rhs.address)
        self.batch = batch_run(lsoda, rhs.address)

    def run(self, times: Floats, y0: Floats, p: Floats, rtol: float) -> Floats:
        """The whole run in one call."""
        states, ok = self._lsoda(self._rhs.address, y0, times, data=p, rtol=rtol, atol=rtol)
        return states if ok else np.full_like(states, np.nan)


def restarted_run(lsoda: Callable, address: int) -> Run:
    """A compiled run that starts `lsoda` at every row."""

    @nb.njit
    def restarted(times: Floats, y0: Floats, p: Floats, rtol: float) -> Floats:
        states = np.empty((times.size, y0.size))
        states[0] = y0
        for row in range(1, times.size):
            last, ok = lsoda(
                address, states[row - 1].copy(), times[row - 1 : row + 1], p, rtol, rtol
            )
            states[row] = last[1]
            if not ok:
                states[row] = np.nan
        return states

    return restarted


def batch_run(lsoda: Callable, address: int) -> Run:
    """A compiled loop over parameter sets (B, parameters) on all threads: their last states
    (B, 8).
    """

    @nb.njit(parallel=True)
    def batch(times: Floats, y0: Floats, sets: Floats, rtol: float) -> Floats:
        ends = np.empty((sets.shape[0], y0.size))
        for lane in nb.prange(sets.shape[0]):
            states, ok = lsoda(address, y0.copy(), times, sets[lane].copy(), rtol, rtol)
            ends[lane] = states[-1]
            if not ok:
                ends[lane] = np.nan
        return ends

    return batch
