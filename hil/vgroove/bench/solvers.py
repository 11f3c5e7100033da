"""The peers of the impact comparison: how each is loaded, its tolerances from loose to tight, and
the command that installs it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
# times (n,) at 1 kHz, start (8,), parameters, tolerance -> states (n, 8)
Run = Callable[[Floats, Floats, Floats, float], Floats]

RTOLS = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 1e-7, 1e-8)
NUMBALSODA, NUMBALSODA_RESTARTED = "numbalsoda LSODA", "numbalsoda, restarted"
FAST = "vgroove, fast"
EULER, EULER_2_US = "C++ Euler", "C++ Euler at 2 us"
STEPS_S = (1e-5, 5e-6, 2e-6, 1e-6, 5e-7, 2e-7, 1e-7)


@dataclass(frozen=True)
class Peer:
    """A solver of the shared model; `tolerance` is a relative tolerance or, for fixed steps, the
    step in seconds.
    """

    name: str
    run: Run
    tolerances: tuple[float, ...] = RTOLS
    tolerance_is: str = "rtol"


@dataclass(frozen=True)
class Missing:
    """A peer that this machine lacks, and the command that installs it."""

    name: str
    install: str


def _numbalsoda() -> Peer:
    from vgroove.bench.impact_peers import Numbalsoda

    return Peer(NUMBALSODA, Numbalsoda().run)


def _numbalsoda_restarted() -> Peer:
    from vgroove.bench.impact_peers import Numbalsoda

    return Peer(NUMBALSODA_RESTARTED, Numbalsoda().restarted)


def _scipy() -> Peer:
    from vgroove.bench.impact_peers import scipy_lsoda

    return Peer("SciPy LSODA", scipy_lsoda)


def _sundae() -> Peer:
    from vgroove.bench.impact_peers import load_sundae

    return Peer("scikit-sundae CVODE", load_sundae())


def _casadi() -> Peer:
    from vgroove.bench.casadi_model import load_casadi

    return Peer("CasADi CVODES", load_casadi())


def _euler(name: str, steps_s: tuple[float, ...]) -> Peer:
    from vgroove.bench import euler

    library = euler.build()

    def run(times: Floats, y0: Floats, p: Floats, step_s: float) -> Floats:
        return euler.run(library, y0, p, times.size - 1, step_s)

    return Peer(name, run, steps_s, "step_s")


PIP = "pip install numba numbalsoda (from source: cmake, gfortran)"
LOADERS: tuple[tuple[str, Callable[[], Peer], str], ...] = (
    (NUMBALSODA, _numbalsoda, PIP),
    (NUMBALSODA_RESTARTED, _numbalsoda_restarted, PIP),
    (EULER_2_US, lambda: _euler(EULER_2_US, (2e-6,)), "apt-get install g++"),
    (EULER, lambda: _euler(EULER, STEPS_S), "apt-get install g++"),
    ("SciPy LSODA", _scipy, "pip install numba"),
    ("CasADi CVODES", _casadi, "pip install casadi"),
    ("scikit-sundae CVODE", _sundae, "pip install numba scikit-sundae"),
)


def load_peers() -> tuple[list[Peer], list[Missing]]:
    """The peers that this machine has, and those that it lacks."""
    found, missing = [], []
    for name, load, install in LOADERS:
        try:
            found.append(load())
        except ImportError:
            missing.append(Missing(name, install))
    return found, missing
