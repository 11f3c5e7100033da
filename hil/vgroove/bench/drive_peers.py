"""The nominal drivetrain for general-purpose solvers (numbalsoda, scikit-sundae, SciPy), with a
right-hand side compiled by numba.
"""

from collections.abc import Callable

import numba as nb
import numpy as np
import numpy.typing as npt
from scipy.integrate import odeint

Floats = npt.NDArray[np.float64]
Solver = Callable[[Floats, Floats, Floats, float], Floats]

# Width of the smooth sign() that a general solver needs; it changes the run by less than the
# accuracy that is compared.
SIGN_WIDTH_RAD_S = 0.02


@nb.njit(cache=False, fastmath=False)
def _derivative(t: float, y: Floats, dy: Floats, p: Floats) -> None:
    """y = current A, speed rad/s, angle rad; p = v0, v_rate, t0, R, L, k, J, b, Tc (voltage v0 +
    v_rate (t - t0)).
    """
    voltage = p[0] + p[1] * (t - p[2])
    dy[0] = (voltage - p[3] * y[0] - p[5] * y[1]) / p[4]
    dy[1] = (p[5] * y[0] - p[7] * y[1] - p[8] * np.tanh(y[1] / SIGN_WIDTH_RAD_S)) / p[6]
    dy[2] = y[1]


@nb.njit
def _odeint_rhs(t: float, y: Floats, p: Floats) -> Floats:
    dy = np.empty(3)
    _derivative(t, y, dy, p)
    return dy


def load_numbalsoda() -> Solver:
    """States (len(times), 3) by numbalsoda's LSODA."""
    from numbalsoda import lsoda, lsoda_sig

    @nb.cfunc(lsoda_sig)
    def rhs(t, u, du, p):  # noqa: ANN001, ANN202 (the signature is numbalsoda's)
        _derivative(t, nb.carray(u, (3,)), nb.carray(du, (3,)), nb.carray(p, (9,)))

    def run(times: Floats, y0: Floats, p: Floats, rtol: float) -> Floats:
        states, ok = lsoda(rhs.address, y0, times, data=p, rtol=rtol, atol=rtol * 1e-2)
        return states if ok else np.full_like(states, np.nan)

    return run


def scipy_lsoda(times: Floats, y0: Floats, p: Floats, rtol: float) -> Floats:
    """States (len(times), 3) by SciPy's odeint (LSODA) with the compiled right-hand side."""
    return odeint(_odeint_rhs, y0, times, args=(p,), rtol=rtol, atol=rtol * 1e-2, tfirst=True)


def load_sundae() -> Solver:
    """States (len(times), 3) by scikit-sundae's CVODE (BDF)."""
    from sksundae.cvode import CVODE

    def run(times: Floats, y0: Floats, p: Floats, rtol: float) -> Floats:
        solver = CVODE(
            lambda t, y, dy: _derivative(t, y, dy, p),
            rtol=rtol,
            atol=rtol * 1e-2,
            max_num_steps=100_000,
        )
        if times.size > 2:
            return solver.solve(times, y0).y
        # for two times it would return its own steps
        between = np.array([times[0], 0.5 * (times[0] + times[1]), times[1]])
        return solver.solve(between, y0).y[[0, 2]]

    return run


def load_scipy() -> Solver:
    """SciPy's LSODA, which is always present."""
    return scipy_lsoda


LOADERS = {
    "numbalsoda LSODA": load_numbalsoda,
    "SciPy LSODA": load_scipy,
    "scikit-sundae CVODE": load_sundae,
}
