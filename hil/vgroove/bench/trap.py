"""`vgroove bench trap`: one joint whose simulation lacks its Coulomb friction. It is a trap for an
identification method that fits only the parameters of the model: which method names the friction,
and which one changes the damping instead?

The true motion is integrated here in steps of 10 us, with friction as an exact impulse, by neither
the plant nor a peer.
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
from vgroove.gap import diagnose
from vgroove.gap.report import verdict_sentence
from vgroove.log import Log
from vgroove.rig import Rig, rig_from_dict
from vgroove.units import RPM_PER_RAD_S

Floats = npt.NDArray[np.float64]

SCHEMA = "vgroove.bench_trap/1"
INERTIA, DAMPING, COULOMB = 2e-3, 2e-3, 0.04  # kg m2, N m s/rad, N m
# The damping that the simulation assumes, and its tolerance (1 sigma, relative)
ASSUMED_DAMPING, DAMPING_SIGMA = 2.5e-3, 0.5
POSITION_NOISE_RAD, SPEED_NOISE_RAD_S = 0.01, 0.3
LOG_HZ, STEPS_PER_ROW = 500, 200
TRAIN_S, NEW_S = 20.0, 8.0
# Torque of the drive: the new data has slower motion, on which friction has more influence
TRAIN_NM, NEW_NM = 0.10, 0.07
TONES_HZ, TONES = (0.4, 0.9, 1.7, 3.1), (1.0, 0.7, 0.5, 0.3)  # frequencies, relative amplitudes


@dataclass(frozen=True)
class TrapPeer:
    """A peer: its name, the module with its `answers`, and the command that installs it."""

    name: str
    module: str
    install: str


PEERS = (
    TrapPeer("MuJoCo sysid", "trap_mujoco", "pip install mujoco[sysid]"),
    TrapPeer("PySINDy residual", "trap_pysindy", "pip install pysindy"),
)

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
viscous_nm_s_per_rad = {ASSUMED_DAMPING}
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
speed_noise_rpm = {SPEED_NOISE_RAD_S * RPM_PER_RAD_S}
[tolerance]
"motor.viscous_nm_s_per_rad" = {DAMPING_SIGMA}
"""


@dataclass(frozen=True)
class Motion:
    """Rows (n,) of the joint: end of the row, torque held over the row, angle and speed at
    its end.
    """

    time_s: Floats
    torque_nm: Floats
    angle_rad: Floats
    speed_rad_s: Floats


@dataclass(frozen=True)
class Answer:
    """Result of a method on the training data, and the error of its model on new data.

    printed_result: the text that the method prints. damping: fitted, N m s/rad. friction_nm:
    Coulomb torque, N m, None where none was found. speed_error: RMS error of the open-loop speed on
    the new data, as a share of the RMS of the speed. cpu_seconds: processor time.
    """

    name: str
    printed_result: str
    damping: float
    friction_nm: float | None
    speed_error: float
    cpu_seconds: float


def excitation(seed: int, seconds: float, size_nm: float) -> tuple[Floats, Floats]:
    """Ends of the rows in s and torques in N m, (n,) each: TONES with random phases."""
    time_s = np.arange(1, round(seconds * LOG_HZ) + 1) / LOG_HZ
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(TONES))
    tones = [
        a * np.sin(2.0 * np.pi * f * time_s + p)
        for f, a, p in zip(TONES_HZ, TONES, phases, strict=True)
    ]
    return time_s, size_nm * np.sum(tones, axis=0)


def simulate_motion(time_s: Floats, torque_nm: Floats) -> Motion:
    """The true motion of the joint from rest under a torque (n,) in N m, held over each row."""
    step = 1.0 / LOG_HZ / STEPS_PER_ROW
    most_rad_s = step * COULOMB / INERTIA  # largest change of the speed by friction in a step
    angle = speed = 0.0
    rows = np.empty((len(time_s), 2))
    for row, torque in enumerate(torque_nm.tolist()):
        for _ in range(STEPS_PER_ROW):
            free = speed + step / INERTIA * (torque - DAMPING * speed)
            speed = free - math.copysign(most_rad_s, free) if abs(free) > most_rad_s else 0.0
            angle += step * speed
        rows[row] = angle, speed
    return Motion(time_s, torque_nm, rows[:, 0], rows[:, 1])


def measured(motion: Motion, seed: int) -> Motion:
    """The motion with the noise of the sensors."""
    rng, count = np.random.default_rng([seed, 1]), len(motion.time_s)
    return Motion(
        motion.time_s,
        motion.torque_nm,
        motion.angle_rad + POSITION_NOISE_RAD * rng.normal(size=count),
        motion.speed_rad_s + SPEED_NOISE_RAD_S * rng.normal(size=count),
    )


def relative_error(speed: Floats, truth: Motion) -> float:
    """RMS error of a speed (n,) over the RMS of the true speed."""
    return float(np.linalg.norm(speed - truth.speed_rad_s) / np.linalg.norm(truth.speed_rad_s))


def predicted(rig: Rig, motion: Motion) -> Floats:
    """Open-loop speed (n,) in rad/s of a rig under the torque of a motion, from rest."""
    torque = _core.LogInput(motion.time_s, "current_a", np.ascontiguousarray(motion.torque_nm))
    rest = np.zeros((1, 3))
    return _core.simulate_log(torque, rig.parameters()[None], np.zeros(1, dtype=np.int64), rest)[
        "speed_rad_s"
    ][0]


def own_answer(train: Motion, new: Motion) -> Answer:
    """The result of `vgroove gap diagnose` on the training log."""
    columns = {
        "current_a": train.torque_nm,
        "speed_rpm": train.speed_rad_s * RPM_PER_RAD_S,
        "position_rad": train.angle_rad,
    }
    start = time.process_time()
    found = diagnose(
        [Log(train.time_s, columns, "one joint")], rig_from_dict(tomllib.loads(RIG), "one joint")
    )
    busy = time.process_time() - start
    corrected = found.corrected_rig()
    return Answer(
        "vgroove gap diagnose",
        verdict_sentence(found),
        corrected.motor["viscous_nm_s_per_rad"],
        corrected.effects.get("coulomb_friction", {}).get("torque_nm"),
        relative_error(predicted(corrected, new), new),
        busy,
    )


def peers() -> tuple[list[Callable[[Motion, Motion], list[Answer]]], list[Missing]]:
    """The `answers` of the peers that this machine has, and the peers that it lacks."""
    found, missing = [], []
    for peer in PEERS:
        try:
            found.append(importlib.import_module(f"vgroove.bench.{peer.module}").answers)
        except ImportError:
            missing.append(Missing(peer.name, peer.install))
    return found, missing


def bench_trap(seed: int = 1) -> dict[str, Any]:
    """The result of every method on the same log, ready for JSON."""
    train = measured(simulate_motion(*excitation(seed, TRAIN_S, TRAIN_NM)), seed)
    new = simulate_motion(*excitation(seed + 1000, NEW_S, NEW_NM))
    others, missing = peers()
    answers = [own_answer(train, new)]
    answers += [answer for answers_of in others for answer in answers_of(train, new)]
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
    """One row a method."""
    title = (
        f"One joint, damping {DAMPING:g} N m s/rad, Coulomb friction {COULOMB:g} N m that the "
        "model lacks"
    )
    columns = (
        "tool",
        "result",
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
            a["printed_result"],
            f"{100 * a['damping_error']:+.1f} %",
            friction,
            f"{100 * a['speed_error']:.2f} %",
            f"{a['cpu_seconds']:.1f}",
        )
    for m in figures["missing"]:
        table.add_row(m["name"], f"not on this machine: {m['install']}", "", "", "", "")
    return table
