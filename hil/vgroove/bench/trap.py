"""`vgroove bench trap`: one joint whose simulation lacks its Coulomb friction. Who retunes the
damping, and who names the friction?

The truth is integrated here, with friction as an exact impulse in steps of 10 us: no peer's and not
the plant's.
"""

import importlib
import math
import time
import tomllib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.table import Table

from vgroove import _core
from vgroove.bench.solvers import Missing
from vgroove.gap.diagnose import diagnose
from vgroove.gap.report import verdict_sentence
from vgroove.log import Log
from vgroove.rig import Rig, rig_from_dict

Floats = npt.NDArray[np.float64]

SCHEMA = "vgroove.bench_trap/1"
INERTIA, DAMPING, COULOMB = 2e-3, 2e-3, 0.04  # kg m2, N m s/rad, N m
# the simulation's, and how far it may be retuned (1 sigma, relative)
BELIEVED_DAMPING, DAMPING_SIGMA = 2.5e-3, 0.5
POSITION_NOISE_RAD, SPEED_NOISE_RAD_S = 0.01, 0.3
LOG_HZ, STEPS_A_ROW = 500, 200
TRAIN_S, NEW_S = 20.0, 8.0
# size of the drive: new data is slower motion, where friction matters more
TRAIN_NM, NEW_NM = 0.10, 0.07
TONES_HZ, TONES = (0.4, 0.9, 1.7, 3.1), (1.0, 0.7, 0.5, 0.3)
RAD_S_TO_RPM = 30.0 / math.pi
MUJOCO, PYSINDY = "MuJoCo sysid", "PySINDy residual"
WAYS = {MUJOCO: "pip install mujoco[sysid]", PYSINDY: "pip install pysindy"}

RIG = f"""
schema = "vgroove.rig/1"
name = "one joint"
[input]
kind = "current_a"
[supply]
voltage_v = 24.0
[motor]
resistance_ohm = 1.0
inductance_h = 1e-3
torque_constant_nm_per_a = 1.0
inertia_kg_m2 = {INERTIA}
viscous_nm_s_per_rad = {BELIEVED_DAMPING}
coulomb_nm = 0.0
[gearbox]
ratio = 1.0
output_inertia_kg_m2 = 0.0
[mechanism]
kind = "none"
[load]
kind = "none"
[sensors]
log_hz = {LOG_HZ}
speed_noise_rpm = {SPEED_NOISE_RAD_S * RAD_S_TO_RPM}
[tolerance]
"motor.viscous_nm_s_per_rad" = {DAMPING_SIGMA}
"""


@dataclass(frozen=True)
class Motion:
    """Rows (n,) of the joint: end of the row s, torque held over it N m, angle rad and speed rad/s
    at its end.
    """

    time_s: Floats
    torque_nm: Floats
    angle_rad: Floats
    speed_rad_s: Floats


@dataclass(frozen=True)
class Answer:
    """What a tool says of the training data and how far its model is from the truth on new data.

    speed_error: RMS error of the speed on the new data, open loop, over the RMS of the speed.
    friction_nm is None where none was found.
    """

    name: str
    says: str
    damping: float
    friction_nm: float | None
    speed_error: float
    cpu_seconds: float


def drive(seed: int, seconds: float, size_nm: float) -> tuple[Floats, Floats]:
    """Ends of the rows, s, and torques, N m: four tones of random phase."""
    time_s = np.arange(1, round(seconds * LOG_HZ) + 1) / LOG_HZ
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(TONES))
    tones = [
        a * np.sin(2.0 * np.pi * f * time_s + p)
        for f, a, p in zip(TONES_HZ, TONES, phases, strict=True)
    ]
    return time_s, size_nm * np.sum(tones, axis=0)


def moved(time_s: Floats, torque_nm: Floats) -> Motion:
    """The joint's true motion from rest."""
    step = 1.0 / LOG_HZ / STEPS_A_ROW
    most = step * COULOMB / INERTIA
    angle = speed = 0.0
    rows = np.empty((len(time_s), 2))
    for row, torque in enumerate(torque_nm.tolist()):
        for _ in range(STEPS_A_ROW):
            free = speed + step / INERTIA * (torque - DAMPING * speed)
            speed = free - math.copysign(most, free) if abs(free) > most else 0.0
            angle += step * speed
        rows[row] = angle, speed
    return Motion(time_s, torque_nm, rows[:, 0], rows[:, 1])


def measured(motion: Motion, seed: int) -> Motion:
    """The motion as noisy sensors show it."""
    rng, count = np.random.default_rng([seed, 1]), len(motion.time_s)
    return Motion(
        motion.time_s,
        motion.torque_nm,
        motion.angle_rad + POSITION_NOISE_RAD * rng.normal(size=count),
        motion.speed_rad_s + SPEED_NOISE_RAD_S * rng.normal(size=count),
    )


def relative_error(speed: Floats, truth: Motion) -> float:
    return float(np.linalg.norm(speed - truth.speed_rad_s) / np.linalg.norm(truth.speed_rad_s))


def predicted(rig: Rig, motion: Motion) -> Floats:
    """Speed (n,) rad/s that a rig shows under a motion's torque, from rest, open loop."""
    torque = _core.LogInput(motion.time_s, "current_a", np.ascontiguousarray(motion.torque_nm))
    rest = np.zeros((1, 3))
    return _core.simulate_log(torque, rig.parameters()[None], np.zeros(1, dtype=np.int64), rest)[
        "speed_rad_s"
    ][0]


def own_answer(seen: Motion, new: Motion) -> Answer:
    """`vgroove gap diagnose` on the training log."""
    columns = {
        "current_a": seen.torque_nm,
        "speed_rpm": seen.speed_rad_s * RAD_S_TO_RPM,
        "position_rad": seen.angle_rad,
    }
    start = time.process_time()
    found = diagnose(
        [Log(seen.time_s, columns, "one joint")], rig_from_dict(tomllib.loads(RIG), "one joint")
    )
    busy = time.process_time() - start
    corrected = found.corrected_rig()
    return Answer(
        "vgroove gap diagnose",
        verdict_sentence(found.verdict),
        corrected.motor["viscous_nm_s_per_rad"],
        corrected.effects.get("coulomb_friction", {}).get("torque_nm"),
        relative_error(predicted(corrected, new), new),
        busy,
    )


def peers() -> tuple[list[Callable[[Motion, Motion], list[Answer]]], list[Missing]]:
    """The peers on this machine, and those that are not."""
    found, missing = [], []
    for name, module in ((MUJOCO, "trap_mujoco"), (PYSINDY, "trap_pysindy")):
        try:
            found.append(importlib.import_module(f"vgroove.bench.{module}").answers)
        except ImportError:
            missing.append(Missing(name, WAYS[name]))
    return found, missing


def bench_trap(seed: int = 1) -> dict[str, Any]:
    """Every tool's answer to the same log, JSON-ready."""
    seen, new = (
        measured(moved(*drive(seed, TRAIN_S, TRAIN_NM)), seed),
        moved(*drive(seed + 1000, NEW_S, NEW_NM)),
    )
    others, missing = peers()
    answers = [own_answer(seen, new)] + [answer for ask in others for answer in ask(seen, new)]
    truth = {
        "damping_nm_s_per_rad": DAMPING,
        "coulomb_nm": COULOMB,
        "inertia_kg_m2": INERTIA,
        "position_noise_rad": POSITION_NOISE_RAD,
        "speed_noise_rad_s": SPEED_NOISE_RAD_S,
        "train_s": TRAIN_S,
        "new_s": NEW_S,
    }
    rows = [asdict(a) | {"damping_error": a.damping / DAMPING - 1.0} for a in answers]
    return {
        "schema": SCHEMA,
        "seed": seed,
        "truth": truth,
        "answers": rows,
        "missing": [asdict(m) for m in missing],
    }


def trap_table(figures: dict[str, Any]) -> Table:
    """One row a tool."""
    title = f"One joint, damping {DAMPING:g} N m s/rad, Coulomb friction {COULOMB:g} N m that the model lacks"
    columns = (
        "tool",
        "what it says",
        "damping off by",
        "friction N m",
        "speed error on new data",
        "cpu s",
    )
    table = Table(*columns, title=title, title_justify="left")
    for a in figures["answers"]:
        friction = "-" if a["friction_nm"] is None else f"{a['friction_nm']:.4f}"
        table.add_row(
            a["name"],
            a["says"],
            f"{100 * a['damping_error']:+.1f} %",
            friction,
            f"{100 * a['speed_error']:.2f} %",
            f"{a['cpu_seconds']:.1f}",
        )
    for m in figures["missing"]:
        table.add_row(m["name"], f"not on this machine: {m['install']}", "", "", "", "")
    return table
