"""Independent reference of the drill driver: docs/spec/model.md, sections 1 to 3 and 7, in SciPy at
rtol 1e-10; shares no code with plant/. Symbols are those of that page, in SI units.

A run is a chain of LSODA integrations, each ended by an event (motor breaks away or stops, clutch
slips or grips, diodes block, pulse mode begins or ends) or at a given time (end of the ramp, load
on and off, coast and drive of pulse mode).
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import LSODA, solve_ivp
from scipy.optimize import brentq

I, W, E, C, Q = range(5)  # noqa: E741  current, motor speed, twist, chuck speed, charge


class ChainedLsoda(LSODA):
    """LSODA whose interpolant begins where its step began: the polynomial of LSODA differs from it
    by the step's error, so that a guard near 0 could change its sign there without a root.
    """

    def _step_impl(self) -> tuple[bool, str | None]:
        self.y_before = self.y.copy()
        return super()._step_impl()

    def _dense_output_impl(self) -> object:
        return chained(super()._dense_output_impl(), self.y_before)


def chained(polynomial: object, y_before: np.ndarray) -> object:
    """The polynomial, with y_before (5,) at the instant at which it begins."""
    inside = polynomial._call_impl

    def impl(t: np.ndarray) -> np.ndarray:
        return np.where(
            t == polynomial.t_old, y_before if t.ndim == 0 else y_before[:, None], inside(t)
        )

    polynomial._call_impl = impl
    return polynomial


@dataclass
class Drill:
    """Values of section 7 (low gear, parameter step 1, normal mode) and motor of section 4."""

    supply: float = 18.0
    r: float = 0.19
    l: float = 1e-4  # noqa: E741
    k: float = 0.0109
    jm: float = 1.6e-5
    b: float = 4.5e-6
    tc: float = 0.012
    n: float = 31.5
    jc: float = 2e-4
    stiffness: float = 3000.0
    damping: float = 0.02
    clutch: float = 30.0
    load: float = 6.0
    w_brk: float = 0.1
    pulse: bool = False
    end: float = 4.0


@dataclass
class State:
    """What holds between two events: signs of sliding and slipping, whether the bridge is open, and
    the times of pulse mode.
    """

    slide: int = 0
    slip: int = 0
    open: bool = False
    pulse_start: float | None = None
    switch: float = np.inf
    pieces: list = field(default_factory=list)


def stribeck(d: Drill, tc: float, w: float) -> float:
    """T = sqrt(2e) (Tbrk - Tc) exp(-(w/wSt)^2) w/wSt + Tc tanh(w/wCoul), Tbrk = 1.2 Tc
    (section 3).
    """
    st, coul = np.sqrt(2.0) * d.w_brk, d.w_brk / 10.0
    return np.sqrt(2.0 * np.e) * 0.2 * tc * np.exp(-((w / st) ** 2)) * w / st + tc * np.tanh(
        w / coul
    )


def grip(d: Drill, y: np.ndarray) -> float:
    """Torque of the shaft while the clutch grips."""
    return d.stiffness * y[E] + d.damping * (y[W] / d.n - y[C])


def rates(d: Drill, s: State, t: float, y: np.ndarray) -> list[float]:
    """Derivatives of the five states."""
    torque = s.slip * d.clutch if s.slip else grip(d, y)
    duty = 1.0 if s.pulse_start is not None else min(1.0, t / 0.3)
    v = (-np.sign(y[I]) if abs(y[I]) > 0 else 0.0) * d.supply if s.open else duty * d.supply
    di = 0.0 if s.open and y[I] == 0.0 else (v - d.r * y[I] - d.k * y[W]) / d.l
    dw = 0.0 if s.slide == 0 else (d.k * y[I] - d.b * y[W] - s.slide * d.tc - torque / d.n) / d.jm
    de = (torque - d.stiffness * y[E]) / d.damping if s.slip else y[W] / d.n - y[C]
    load = stribeck(d, d.load, y[C]) if 2.0 <= t < 3.0 else 0.0
    return [di, dw, de, (torque - load) / d.jc, y[I]]


def charge_at(s: State, t: float) -> float:
    """Charge at an earlier instant, from the dense output of the pieces before."""
    for start, end, sol in reversed(s.pieces):
        if start <= t <= end:
            return float(sol(t)[Q])
    return 0.0


def events_of(d: Drill, s: State) -> dict[str, object]:
    """Guards that end an integration where they fall through 0."""
    guards = {}
    if s.slide == 0:
        guards["break"] = lambda t, y: d.tc - abs(d.k * y[I] - grip(d, y) / d.n)
    else:
        guards["rest"] = lambda t, y: s.slide * y[W]
    guards["clutch"] = (
        (lambda t, y: s.slip * grip(d, y) - d.clutch)
        if s.slip
        else (lambda t, y: d.clutch - abs(grip(d, y)))
    )
    if s.open:
        guards["diode"] = lambda t, y: y[I] if y[I] != 0.0 else 1.0
    if d.pulse and s.pulse_start is None:
        guards["pulse"] = lambda t, y: 15.0 - y[I]
    for guard in guards.values():
        guard.terminal, guard.direction = True, -1
    return guards


def pulse_mode_end(d: Drill, s: State, sol: object, t0: float, t1: float) -> float | None:
    """First instant in t0..t1 at which the moving average over 0.1 s, tested from 0.1 s after pulse
    mode began, is below 8 A.
    """
    if s.pulse_start is None or t1 < s.pulse_start + 0.1:
        return None

    def over(t: float) -> float:
        then = t - 0.1
        return (sol(t)[Q] - (sol(then)[Q] if then > t0 else charge_at(s, then))) / 0.1 - 8.0

    grid = np.linspace(max(t0, s.pulse_start + 0.1), t1, 40)
    values = np.array([over(t) for t in grid])
    below = np.flatnonzero(values < 0.0)
    if not below.size:
        return None
    first = below[0]
    return (
        float(grid[0])
        if first == 0
        else float(brentq(over, grid[first - 1], grid[first], xtol=1e-12))
    )


def switch_pulse(s: State, t: float) -> None:
    """Change between coasting (25 ms) and driving (75 ms) in pulse mode."""
    s.open = not s.open
    s.switch = t + (0.025 if s.open else 0.075)


def settle(d: Drill, s: State, name: str, t: float, y: np.ndarray) -> None:
    """Apply an event: the modes and states that it changes."""
    torque = d.k * y[I] - (s.slip * d.clutch if s.slip else grip(d, y)) / d.n
    if name == "break":
        s.slide = int(np.sign(torque))
    elif name == "rest":
        y[W] = 0.0
        s.slide = int(np.sign(torque)) if abs(torque) > d.tc else 0
    elif name == "clutch":
        s.slip = 0 if s.slip else int(np.sign(grip(d, y)))
    elif name == "diode":
        y[I] = 0.0
    elif name == "pulse":
        s.pulse_start = t
        s.open = False
        switch_pulse(s, t)


def run(d: Drill, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Current, motor speed and chuck speed at the rows' times (n,)."""
    s, y, t = State(), np.zeros(5), 0.0
    out = np.full((len(rows), 5), np.nan)
    while t < d.end - 1e-12:
        fixed_times = [
            x
            for x in (
                0.3,
                2.0,
                3.0,
                s.switch,
                d.end,
                np.inf if s.pulse_start is None else s.pulse_start + 0.1,
            )
            if x > t + 1e-12
        ]
        stop = min(fixed_times)
        guards = events_of(d, s)
        found = solve_ivp(
            lambda u, x: rates(d, s, u, x),
            (t, np.nextafter(stop, 0.0)),
            y,
            ChainedLsoda,
            rtol=1e-10,
            atol=[1e-8, 1e-6, 1e-13, 1e-8, 1e-10],
            events=list(guards.values()),
            dense_output=True,
        )
        t1, name = (found.t[-1], None)
        for key, times in zip(guards, found.t_events, strict=True):
            name = key if times.size and times[0] == t1 else name
        ended = pulse_mode_end(d, s, found.sol, t, t1)
        t1, name = (
            (ended, "pulse_end")
            if ended is not None and ended < t1
            else (t1 if name else stop, name)
        )
        here = (rows >= t) & (rows <= t1)
        out[here] = found.sol(rows[here]).T if here.any() else np.empty((0, 5))
        s.pieces = [p for p in s.pieces if p[1] > t - 0.2] + [(t, t1, found.sol)]
        y, t = np.array(found.sol(t1)), t1
        if name == "pulse_end":
            s.pulse_start, s.switch, s.open = None, np.inf, False
        elif name:
            settle(d, s, name, t, y)
        elif t >= s.switch - 1e-12:
            switch_pulse(s, t)
    return {"current_a": out[:, I], "speed_rad_s": out[:, W], "chuck_rad_s": out[:, C]}
