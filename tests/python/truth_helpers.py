"""Shared by the tests of the generator: its modules, settings, and the nominal model of
docs/spec/model.md integrated by SciPy.
"""

import pickle
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
from scipy.integrate import solve_ivp

TRUTH = Path(__file__).resolve().parents[1] / "truth"
if str(TRUTH) not in sys.path:
    sys.path.insert(0, str(TRUTH))

import cases  # noqa: E402
import sealed  # noqa: E402
from cases import (  # noqa: E402
    NOISELESS,
    Setting,
    columns,
    effect_params,
    simulate,
    visibility,
    visible_limit,
)
from effects import BY_ID, CATALOGUE, FIRST, OUTSIDE, top_speed  # noqa: E402
from profiles import draw  # noqa: E402
from rigs import REFERENCE, Rig  # noqa: E402
from signals import RPM_PER_RAD_S, deviations, gap, hall_rows, speed_column  # noqa: E402
from truth import Command, Generator, Run, TruthTool  # noqa: E402

__all__ = [
    "BY_ID",
    "CATALOGUE",
    "FIRST",
    "OUTSIDE",
    "RPM_PER_RAD_S",
    "NOISELESS",
    "TRUTH",
    "Command",
    "Generator",
    "Run",
    "Setting",
    "TruthTool",
    "columns",
    "deviations",
    "effect_params",
    "gap",
    "hall_rows",
    "nominal_run",
    "sealed",
    "setting_of",
    "simulate",
    "simulate_once",
    "simulated_once",
    "speed_column",
    "steady",
    "top_speed",
    "visibility",
    "visible_limit",
]


def setting_of(profile: str, seconds: float = 3.0, seed: int = 5, **rig_changes: object) -> Setting:
    """The reference tool on a profile, with loads of about 6 A if the profile has loads."""
    rig = replace(REFERENCE, slew_per_s=6.0, **rig_changes)
    made = draw(
        profile,
        seconds,
        6.0 * rig.torque_constant_nm_per_a * rig.ratio,
        np.random.default_rng(seed),
    )
    rig = replace(rig, load="torque" if len(made.load_time_s) else "none")
    return Setting(rig, rig, made, seconds, seed)


_RUNS: dict[bytes, tuple] = {}
KEPT_RUNS = 32


def simulate_once(setting: Setting, params: dict[str, float]) -> tuple:
    """`cases.simulate`, whose last results are kept; their arrays must not be written."""
    key = pickle.dumps((setting, sorted(params.items())))
    if key not in _RUNS:
        while len(_RUNS) >= KEPT_RUNS:
            del _RUNS[next(iter(_RUNS))]
        _RUNS[key] = simulate(setting, params)
        for array in vars(_RUNS[key][0]).values():
            if isinstance(array, np.ndarray):
                array.flags.writeable = False
    else:
        _RUNS[key] = _RUNS.pop(key)  # the run used last is dropped last
    return _RUNS[key]


@contextmanager
def simulated_once() -> Iterator[None]:
    """Within, visibilities and visible limits simulate equal runs once."""
    with patch.object(cases, "simulate", simulate_once):
        yield


def steady(duty: float, seconds: float = 0.8, **params: float) -> dict[str, float]:
    """States of the reference tool after `seconds` at a duty from rest."""
    tool = Generator(**params)
    time = np.array([0.0, seconds + 1.0])
    tool.run(
        Command(time, np.full(2, duty), np.zeros(2), np.zeros(0), np.zeros(0)), np.array([seconds])
    )
    return tool.inside()


class Nominal:
    """docs/spec/model.md, sections 1 and 2: bridge averaged, friction as a sign with sticking. The
    states are current, speed, angle, charge and the integral of the bus voltage; `way` is the sign
    of the motion, 0 at rest.
    """

    def __init__(self, rig: Rig, command: Command) -> None:
        self.rig, self.command, self.way = rig, command, 0
        self.inertia = rig.inertia_kg_m2 + rig.output_inertia_kg_m2 / rig.ratio**2

    def dry(self, t: float) -> float:
        load = (
            np.interp(t, self.command.load_time_s, self.command.load_nm)
            if len(self.command.load_time_s)
            else 0.0
        )
        return self.rig.coulomb_nm + load / self.rig.ratio

    def rates(self, t: float, x: np.ndarray) -> list[float]:
        rig, current, speed = self.rig, x[0], x[1] if self.way else 0.0
        duty = np.interp(t, self.command.time_s, self.command.duty)
        bus = rig.voltage_v - rig.supply_resistance_ohm * duty * current
        current_rate = (
            duty * bus - rig.resistance_ohm * current - rig.torque_constant_nm_per_a * speed
        ) / rig.inductance_h
        torque = (
            rig.torque_constant_nm_per_a * current
            - rig.viscous_nm_s_per_rad * speed
            - self.way * self.dry(t)
        )
        return [current_rate, torque / self.inertia if self.way else 0.0, speed, current, bus]

    def margin(self, t: float, x: np.ndarray) -> float:
        """Falls through zero where motion or rest ends: the shaft stops, or the torque at rest
        exceeds the dry friction.
        """
        if self.way:
            return self.way * x[1] + 1e-9
        return self.dry(t) - abs(self.rig.torque_constant_nm_per_a * x[0])

    def switch(self, t: float, x: np.ndarray) -> None:
        """Set the sign of the motion after an event by the torque, 0 where friction holds it."""
        torque = self.rig.torque_constant_nm_per_a * x[0]
        self.way = int(np.sign(torque)) if abs(torque) >= self.dry(t) * (1 - 1e-9) else 0
        x[1] = 1e-7 * self.way


def nominal_run(rig: Rig, command: Command, rows: np.ndarray) -> Run:
    """The nominal model over the rows (n,) by LSODA with rtol 1e-8; current and bus voltage are
    means over each row.
    """
    model, t, x = Nominal(rig, command), 0.0, np.zeros(5)

    def margin(time: float, state: np.ndarray) -> float:
        return model.margin(time, state)

    margin.terminal, margin.direction = True, -1.0
    found = [x.copy()]
    while len(found) <= len(rows):
        ahead = rows[len(found) - 1 :]
        part = solve_ivp(
            model.rates,
            (t, rows[-1]),
            x,
            "LSODA",
            ahead,
            events=margin,
            rtol=1e-8,
            atol=1e-9,
            max_step=2e-3,
        )
        found += list(part.y.T)
        if part.status != 1:
            break
        t, x = float(part.t_events[0][-1]), part.y_events[0][-1].copy()
        model.switch(t, x)
    states = np.array(found)
    length = np.diff(rows, prepend=0.0)
    mean = np.diff(states[:, 3:], axis=0) / length[:, None]
    none = np.zeros(0)
    return Run(
        0.0,
        rows,
        mean[:, 0],
        mean[:, 1],
        states[1:, 1],
        states[1:, 2],
        np.zeros(len(rows)),
        none,
        none,
    )
