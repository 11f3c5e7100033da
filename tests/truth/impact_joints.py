"""Slip torques of the joints of docs/spec/model.md, section 6, over the head angle, with the
effects of a joint and its roughness.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from impact_rigs import ImpactRig
from impact_tool import SlipTorque

STEP_RAD = np.radians(0.5)
TURN = 2.0 * np.pi
MOST_TURNS = 60.0  # of the table, forwards and backwards
# Disc spring 40 x 20.4 x 1.5 and bolt M16: docs/spec/model.md, section 6
OUTER_M, INNER_M, THICK_M, CONE_M = 0.040, 0.0204, 0.0015, 0.00115
YOUNG_PA, POISSON = 206e9, 0.3
PITCH_M, FLANK_M, HEAD_M = 2e-3, 14.701e-3, 20e-3
FLAT_NM_PER_RAD = 700.0  # slope of the slip torque of springs that lie flat
STRIP_RAD = np.pi / 2  # stripping wood loses half of the seat torque over this angle
KNOT_EDGE = 0.15  # of the width of a knot: its flanks are smooth
# Keys of an effect that belong to the joint's slip torque; the bends and the skew are those of
# forms other than the catalogue's
JOINT_KEYS = (
    "joint_friction",
    "joint_friction_bend",
    "joint_bend_rad",
    "joint_hysteresis",
    "joint_hysteresis_bend",
    "knot_nm",
    "knot_from_rad",
    "knot_to_rad",
    "knot_skew",
)


@dataclass(frozen=True)
class Roughness:
    """Relative variation of the slip torque along the head angle: smooth and random."""

    sigma: float
    length_rad: float
    seed: int


def disc_force_n(rig: ImpactRig, turns: np.ndarray) -> np.ndarray:
    """Force of the disc springs (n,) after turns of the bolt (n,), DIN EN 16984."""
    ratio = OUTER_M / INNER_M
    shape = ((ratio - 1) / ratio) ** 2 / ((ratio + 1) / (ratio - 1) - 2 / np.log(ratio)) / np.pi
    pressed = np.clip(turns, 0.0, flat_turns(rig)) * PITCH_M / rig["load.series"]
    s, h = pressed / THICK_M, CONE_M / THICK_M
    scale = 4 * YOUNG_PA / (1 - POISSON**2) * THICK_M**4 / (shape * OUTER_M**2)
    return rig["load.parallel"] * scale * s * ((h - s) * (h - s / 2) + 1)


def flat_turns(rig: ImpactRig) -> float:
    """Turns of the bolt that press the disc springs flat."""
    return rig["load.series"] * CONE_M / PITCH_M


def wood_nm(rig: ImpactRig, turns: np.ndarray) -> np.ndarray:
    """Slip torque of a wood screw (n,) at a depth in turns (n,): drive, seat, stripping."""
    end, seat = rig["load.end_nm"], rig["load.seat_nm"]
    drive = rig["load.start_nm"] + (end - rig["load.start_nm"]) * turns / rig["load.turns"]
    over = (turns - rig["load.turns"]) * TURN
    seating = np.radians(rig["load.seat_deg"])
    ramp = end + (seat - end) * over / seating
    strip = seat * np.maximum(1.0 - 0.5 * (over - seating) / STRIP_RAD, rig["load.stripped_ratio"])
    rising = np.where(over <= 0.0, np.maximum(drive, rig["load.start_nm"]), ramp)
    return np.where(turns < 0.0, 0.0, np.where(over > seating, strip, rising))


def discs_nm(
    rig: ImpactRig, turns: np.ndarray, effect: dict[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Slip torques of disc springs (n,), forwards and backwards, by the bolt's formula."""
    force = disc_force_n(rig, turns)
    head = (turns - rig["load.from_turns"]) * TURN
    friction = rig["load.friction"] * friction_scale(head, effect) * (0.58 * FLANK_M + 0.5 * HEAD_M)
    bend = effect.get("joint_hysteresis_bend", 0.0) * (force / max(force.max(), 1.0) - 0.5)
    back = force * (1.0 - effect.get("joint_hysteresis", 0.0) * (1.0 + bend))
    run = rig["load.run_torque_nm"]
    flat = FLAT_NM_PER_RAD * TURN * np.maximum(turns - flat_turns(rig), 0.0)
    forward = run + force * (friction + 0.16 * PITCH_M) + flat
    return forward, run + back * (friction - 0.16 * PITCH_M) + flat


def friction_scale(head: np.ndarray, effect: dict[str, float]) -> np.ndarray:
    """Factor of the friction of a joint (n,); with a bend the effect grows along the head angle."""
    along = np.tanh(np.abs(head) / effect.get("joint_bend_rad", 1.0)) - 0.5
    bend = 1.0 + effect.get("joint_friction_bend", 0.0) * along
    return 1.0 + effect.get("joint_friction", 0.0) * bend


def knot_nm(head: np.ndarray, effect: dict[str, float]) -> np.ndarray:
    """Torque of a knot in the wood (n,) over the head angle, with smooth flanks."""
    begin, end = effect["knot_from_rad"], effect["knot_to_rad"]
    edge = KNOT_EDGE * (end - begin)
    rise = np.clip((head - begin + 0.5 * edge) / edge, 0.0, 1.0)
    fall = np.clip((end - head + 0.5 * edge) / edge, 0.0, 1.0)
    skew = 1.0 + effect.get("knot_skew", 0.0) * ((head - begin) / (end - begin) - 0.5)
    return effect["knot_nm"] * skew * (0.5 - 0.5 * np.cos(np.pi * np.minimum(rise, fall)))


def head_angles(joint: str) -> np.ndarray:
    """Head angles (n,) of the table: both ways for screws, a turn backwards for hard joints."""
    if joint == "hard_joint":
        return np.arange(-TURN, 12.0 * TURN, STEP_RAD)
    return np.arange(-MOST_TURNS * TURN, MOST_TURNS * TURN, 4.0 * STEP_RAD)


def slip_torque(
    rig: ImpactRig, effect: dict[str, float], roughness: Roughness | None
) -> SlipTorque:
    """The slip torques of the joint with an effect (keys JOINT_KEYS) and roughness."""
    head = head_angles(rig.joint)
    scale = friction_scale(head, effect)
    if rig.joint == "hard_joint":
        gained = rig["load.slip_slope_nm_per_rad"] * np.maximum(head, 0.0)
        run = rig["load.run_torque_nm"]
        forward = scale * (run + gained)
        backward = scale * (run + rig["load.loosen_ratio"] * gained)
    elif rig.joint == "disc_spring":
        turns = rig["load.from_turns"] + head / TURN
        forward, backward = discs_nm(rig, turns, effect)
    else:
        forward = scale * wood_nm(rig, rig["load.from_turns"] + head / TURN)
        forward = forward + (knot_nm(head, effect) if "knot_nm" in effect else 0.0)
        backward = rig["load.loosen_ratio"] * forward
    rough = 1.0 + (rough_table(rig.joint, roughness) if roughness and not rig.locked else 0.0)
    step = float(head[1] - head[0])
    return SlipTorque(forward * rough, backward * rough, float(head[0]), step)


@lru_cache(maxsize=64)
def rough_table(joint: str, roughness: Roughness) -> np.ndarray:
    """The roughness at the head angles of the table of a kind of joint, (n,)."""
    return rough_part(head_angles(joint), roughness)


def rough_part(head: np.ndarray, roughness: Roughness) -> np.ndarray:
    """Relative deviation of the slip torque (n,): 24 harmonics of random phase and a Gaussian
    spectrum about the inverse of the length.
    """
    rng = np.random.default_rng([roughness.seed, 41])
    waves = np.abs(rng.standard_normal(24)) / roughness.length_rad
    phases = rng.uniform(0.0, TURN, 24)
    out = np.zeros(len(head))
    for wave, phase in zip(waves, phases, strict=True):
        out += np.cos(wave * head + phase)
    return np.maximum(roughness.sigma * out / np.sqrt(12.0), -0.5)
