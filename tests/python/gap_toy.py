"""A small test double of a measured problem (residual/protocol.py) in numpy alone, so that tests of
the decision logic need neither plant nor logs.

Windows of 0.25 s restart from the true state and run in parallel; the winding's inductance is left
out, so that steps of 1 ms are enough. It has no logs and no effect that follows the angle.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest

from vgroove.gap.catalogue import BY_ID, CATALOGUE, Scales
from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.residual.agreement import clip_sigmas
from vgroove.gap.residual.measured_run import MeasuredRun
from vgroove.gap.residual.problem import Problem
from vgroove.gap.residual.restart_angles import RestartAngles
from vgroove.gap.selection.search_state import Search
from vgroove.rig import rig_from_dict

DT, WINDOW, COUNT = 1e-3, 250, 24  # row interval in s, rows between restarts, number of restarts
RIG = {
    "motor.resistance_ohm": 0.19,
    "motor.torque_constant_nm_per_a": 0.0109,
    "motor.inertia_kg_m2": 1.8e-5,
    "motor.viscous_nm_s_per_rad": 4.5e-6,
    "motor.coulomb_nm": 0.012,
    "supply.voltage_v": 18.0,
}
TOOL = {
    "schema": "vgroove.rig/1",
    "name": "toy",
    "input": {"kind": "duty"},
    "supply": {"voltage_v": 18.0},
    "motor": {
        "resistance_ohm": 0.19,
        "inductance_h": 1e-4,
        "torque_constant_nm_per_a": 0.0109,
        "inertia_kg_m2": 1.8e-5,
        "viscous_nm_s_per_rad": 4.5e-6,
        "coulomb_nm": 0.012,
    },
    "gearbox": {"ratio": 1.0, "output_inertia_kg_m2": 0.0},
    "load": {"kind": "none"},
    "mechanism": {"kind": "none"},
    "sensors": {"log_hz": 1000},
}
# values of parameters that must not be 0 in a model without their effect
NEUTRAL = {"effects.stribeck_friction.speed_rad_s": 1.0}
MAX_SLOPE_ERROR = 0.1  # of a slope's norm
SIGMA = {"current_a": 0.15, "speed_rpm": 20.0, "supply_v": 0.02}
# what the log holds, as flags of Effect.needs
FLAGS = frozenset({"duty", "voltage", "current", "speed", "supply", "both"})
# effects that _run() simulates
MODELLED = (
    "supply_resistance",
    "winding_resistance",
    "brush_drop",
    "torque_constant",
    "coulomb_friction",
    "viscous_friction",
    "stribeck_friction",
    "quadratic_drag",
    "asymmetric_friction",
    "directional_viscous",
    "added_inertia",
    "current_gain",
    "current_offset",
    "speed_gain",
    "transport_delay",
)
SCALES = Scales(
    volt=18.0,
    amp=40.0,
    speed=1500.0,
    torque=0.4,
    inertia=1.8e-5,
    motor_inertia=1.8e-5,
    resistance=0.19,
    coulomb=0.012,
    viscous=4.5e-6,
    ratio=5.6,
    duration=6.0,
    interval=1e-3,
    pwm_hz=2e4,
    supply_ohm=0.0,
)


@dataclass
class Signal:
    """A judged column: see residual.problem.SignalInfo."""

    column: str
    unit: str
    sigma: float
    noise_is_known: bool = False


class Toy:
    """A MeasuredProblem without prepared logs. Its measurement is its own simulation with hidden
    effects (parameter values by name) and noise.

    still_speed: the duty is a single step, not ramps; oscillation_a: amplitude, A, of an
    oscillation of the measured current that no effect explains.
    """

    runs: tuple[MeasuredRun, ...] = ()
    angles = RestartAngles(())
    rig = rig_from_dict(TOOL, "toy")
    missed_edges = (0.0, 0.0)
    difference_factor = 1.0
    sigma_is_bound = False
    is_whitened = False
    has_lanes = True

    def __init__(
        self,
        hidden: dict[str, float],
        seed: int = 1,
        still_speed: bool = False,
        oscillation_a: float = 0.0,
    ) -> None:
        self.parameters = [
            *RIG,
            *(e.name(p) for e in CATALOGUE for p in e.parameters),
            "effects.speed_lag.lag_form",
            "effects.clock_skew.command_clock",
        ]
        self.theta0 = np.array([RIG.get(n, NEUTRAL.get(n, 0.0)) for n in self.parameters])
        self.signals = [
            Signal("current_a", "A", 0.15),
            Signal("speed_rpm", "rpm", 20.0),
            Signal("supply_v", "V", 0.02),
        ]
        t = np.arange(COUNT * WINDOW) * DT
        self.duty = np.where(t > 0.4, 0.6, 0.0) if still_speed else duty(t)
        truth = self.theta0.copy()
        for name, value in hidden.items():
            truth[self.index(name)] = value
        self.starts = np.zeros(COUNT)
        whole = self._run(truth[None, :], self.duty[None, :], np.zeros((1, 1)))
        speed = (
            whole[1, 0] * np.pi / 30.0 / (1.0 + truth[self.index("effects.speed_gain.relative")])
        )
        self.starts = np.concatenate([[0.0], speed[WINDOW - 1 : -1 : WINDOW]])
        exact = self.simulate(truth[None, :])[:, 0]
        rng = np.random.default_rng(seed)
        sigma = np.array([s.sigma for s in self.signals])[:, None]
        self.measured_rows = exact + sigma * rng.standard_normal(exact.shape)
        self.measured_rows[0] += oscillation_a * np.sin(2 * np.pi * 7.3 * t)
        n = exact.shape[1]
        self.n = 3 * n
        self.signal = np.repeat(np.arange(3), n)
        self.row = np.tile(np.arange(n), 3)
        self.time_s = np.tile(t, 3)
        self.log = np.zeros(self.n, int)
        self.censored = np.zeros(self.n, bool)
        self.block = (self.time_s // 0.75).astype(int) + 1
        self.fold = (self.block - 1) % 4
        self.folds = [(self.fold != k, self.fold == k) for k in range(4)]
        self.judged = np.ones(self.n, bool)
        self.held_out_s = [[(0.75 * b, 0.75 * (b + 1)) for b in range(8)]]
        self.restart_s = 0.25
        self.regimes = ["slow", "fast"]
        self.regime = np.tile((np.abs(self.measured_rows[1]) > 5000).astype(int), 3)
        self.sigma = np.repeat(sigma[:, 0], n)
        self.measured = self.measured_rows.ravel()
        self.warnings: list[str] = []

    @cached_property
    def clip(self) -> np.ndarray:
        """Sigmas (3,) at which the residuals of each signal are clipped in a gap."""
        size = np.abs(self.residuals(self.theta0)[0])
        return np.array([clip_sigmas(size[self.signal == k]) for k in range(3)])

    def index(self, name: str) -> int:
        """Column of a flat parameter."""
        return self.parameters.index(name)

    def simulate(self, theta: np.ndarray) -> np.ndarray:
        """Signals (3, B, n)."""
        out = self._run(
            theta, self.duty.reshape(COUNT, WINDOW), self.starts[None, :].repeat(len(theta), 0)
        )
        return out.reshape(3, len(theta), -1)

    def _run(self, theta: np.ndarray, commands: np.ndarray, w: np.ndarray) -> np.ndarray:
        def p(name: str) -> np.ndarray:
            return theta[:, self.index(name)][:, None]

        def e(name: str) -> np.ndarray:
            return p("effects." + name)

        k = p("motor.torque_constant_nm_per_a") * (1 + e("torque_constant.relative"))
        r = p("motor.resistance_ohm") * (1 + e("winding_resistance.relative"))
        inertia = p("motor.inertia_kg_m2") + e("added_inertia.kg_m2")
        coulomb = p("motor.coulomb_nm") + e("coulomb_friction.torque_nm")
        viscous = p("motor.viscous_nm_s_per_rad") + e("viscous_friction.nm_s_per_rad")
        breakaway = e("stribeck_friction.breakaway_nm")
        stribeck_speed = e("stribeck_friction.speed_rad_s")
        quadratic = e("quadratic_drag.nm_s2_per_rad2")
        directional = e("directional_viscous.nm_s_per_rad")
        forward = e("asymmetric_friction.forward_nm")
        backward = e("asymmetric_friction.backward_nm")
        source, brush = p("supply.voltage_v"), e("brush_drop.voltage_v")
        supply_ohm = e("supply_resistance.resistance_ohm")
        times = (np.arange(commands.size) * DT).reshape(commands.shape)
        delayed = np.interp(
            times - e("transport_delay.delay_s")[..., None],
            np.arange(self.duty.size) * DT,
            self.duty,
        )
        falls, spins = breakaway.any(), quadratic.any() or directional.any()
        leans, drops = forward.any() or backward.any(), brush.any()
        delayed = np.ascontiguousarray(np.moveaxis(delayed, -1, 0))
        drive, resistance = delayed * source, r + delayed * delayed * supply_ohm
        current, speed = np.empty_like(drive), np.empty_like(drive)
        for n in range(commands.shape[1]):
            i = (drive[n] - k * w) / resistance[n]
            if drops:
                i = i - np.sign(i) * np.minimum(np.abs(i) * r, brush) / r
            s = np.tanh(w / 2.0)
            friction = coulomb * s + viscous * w
            if falls:
                friction = friction + breakaway * np.exp(-((w / stribeck_speed) ** 2)) * s
            if spins:
                size = np.abs(w)
                friction = friction + (quadratic * w * size + directional * size)
            if leans:
                friction = friction + np.where(s > 0, s * forward, s * backward)
            w = w + DT * (k * i - friction) / inertia
            current[n], speed[n] = i, w
        seen = (
            current * (1 + e("current_gain.relative")) + e("current_offset.offset_a"),
            speed * 30 / np.pi * (1 + e("speed_gain.relative")),
            source - supply_ohm * (delayed * current),
        )
        return np.moveaxis(np.stack(seen), 1, -1).reshape(3, len(theta), -1)

    def residuals(self, theta: np.ndarray, angles: RestartAngles | None = None) -> np.ndarray:
        """(measured - model) / sigma, (B, n); no effect depends on the angles."""
        sim = self.simulate(np.atleast_2d(theta))
        return (
            (
                (self.measured_rows[:, None] - sim)
                / np.array([s.sigma for s in self.signals])[:, None, None]
            )
            .transpose(1, 0, 2)
            .reshape(len(np.atleast_2d(theta)), -1)
        )

    def squared(self, r: np.ndarray) -> np.ndarray:
        """Squares, clipped at the clip of each signal."""
        return np.minimum(np.square(r), np.square(self.clip)[self.signal])

    power_by_regime = Problem.power_by_regime

    def gap(self, r: np.ndarray, mask: np.ndarray | None = None) -> float:
        """Clipped RMS."""
        return float(np.sqrt(self.squared(r)[self.judged if mask is None else mask].mean()))

    def floor(self, mask: np.ndarray | None = None) -> float:
        """The gap that noise alone leaves: sigma is the standard deviation of the noise."""
        return 1.0

    def gap_by_signal(self, r: np.ndarray, mask: np.ndarray | None = None) -> dict[str, float]:
        """RMS of each signal in its unit, not clipped."""
        mask = self.judged if mask is None else mask
        return {
            s.column: s.sigma * float(np.sqrt((r[mask & (self.signal == i)] ** 2).mean()))
            for i, s in enumerate(self.signals)
        }

    def rms_by_signal(self, mask: np.ndarray | None = None) -> dict[str, float]:
        """RMS of each measured signal in its unit."""
        mask = self.judged if mask is None else mask
        return {
            s.column: float(np.sqrt((self.measured[mask & (self.signal == i)] ** 2).mean()))
            for i, s in enumerate(self.signals)
        }

    def floor_by_signal(self, mask: np.ndarray | None = None) -> dict[str, float]:
        """RMS of each signal that noise alone leaves."""
        return {s.column: s.sigma for s in self.signals}

    def iso18571(self, r: np.ndarray, mask: np.ndarray | None = None) -> dict[str, float | None]:
        """No signal is rated."""
        return {s.column: None for s in self.signals}


def duty(t: np.ndarray) -> np.ndarray:
    """Ramps and holds in both directions, from rest."""
    knots_t = [0, 0.3, 0.5, 1.2, 1.3, 2.0, 2.3, 2.9, 3.2, 3.8, 4.1, 4.7, 5.0, 5.5, 6.0]
    knots_d = [0, 0.0, 0.6, 0.6, 0.9, 0.9, 0.2, 0.2, -0.5, -0.5, -0.8, -0.8, 0.4, 0.4, 0.1]
    return np.interp(t, knots_t, knots_d)


def fit_of(toy: Toy, *ids: str, tolerance: dict[str, float] | None = None) -> tuple[Engine, Fit]:
    """The engine of a toy and the best fit of a set of effects over its starts."""
    engine = Engine(toy, SCALES, tolerance or {})
    fits = engine.fit(engine.hypotheses([BY_ID[i] for i in ids]))
    best = min(fits, key=lambda f: f.cost)
    predict_held_out(engine, [best])
    return engine, best


def assert_consistent(state: Search, one: Fit) -> None:
    """Residuals, cost and Jacobian of a fit are those that the engine of the search computes."""
    (row,) = state.engine.residuals([(one.hypothesis, one.x[None, :])])
    np.testing.assert_allclose(one.residual, row, atol=1e-9)
    assert one.cost == pytest.approx(state.engine.cost(one, one.x, row))
    if one.jacobian_is_at_x and len(one.x):
        step = 1e-4
        (moved,) = state.engine.residuals(
            [(one.hypothesis, (one.x + step * np.eye(len(one.x))[0])[None, :])]
        )
        slope = (moved - row) / step
        # the slopes jump in the few rows in which the shaft reverses
        error = np.linalg.norm(one.jacobian[:, 0] - slope)
        assert error < MAX_SLOPE_ERROR * np.linalg.norm(slope)
