"""Effects in impact mode against their equations in docs/spec/gap.md, section 3: each term is
computed from the simulated motion by balances.

The torque on motor, spindle and hammer together is N (k i - T) = (JJ + N^2 Jm) w' / N + JS wS' +
Tlug, whatever the groove does, so the friction T at the motor shaft follows from the motion; so do
the voltage across the winding and the torque through the groove.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from test_impact_laws import EFFECTS, JOINTS, drive
from test_impact_plant import rig_with

# Reference set of docs/spec/model.md, section 4, in its symbols
N, K, JM, JJ, JS, L_H, R, RS, VOC, B, TC = (
    5.6,
    0.0109,
    1.6e-5,
    6e-6,
    4.5e-5,
    1e-4,
    0.19,
    0.10,
    18.5,
    4.5e-6,
    0.012,
)
F0, RATE, MASS, LEAD, RADIUS, JA = 220.0, 29400.0, 0.19, 4.4e-3, 0.010, 1.2e-5
PWM_HZ, DUTY = 31372.5, 0.9
STEP_S, FROM_S, TO_S = 2e-6, 0.06, 0.12
Trace = dict[str, np.ndarray]


def motion(joint: str = "slip 60", duty: float = DUTY, **effects: dict[str, float]) -> Trace:
    """Columns every 2 us from rest, with time derivatives. `smooth`: samples after the first
    impacts without an event within four samples. `untouched`: of these, samples without contact
    of a lug within four samples.
    """
    time_s = np.arange(0.0, TO_S, STEP_S)
    t = drive(rig_with(JOINTS[joint]).with_effects(effects), np.full(125, duty), trace_s=time_s)[
        "trace"
    ]
    moving = ("current_a", "speed_rad_s", "hammer_rad_s", "anvil_rad_s", "hammer_m_per_s")
    t |= {f"d_{name}": np.gradient(t[name], STEP_S) for name in moving}
    bend = np.abs(np.diff(t["d_anvil_rad_s"], 2, prepend=0.0, append=0.0))
    smooth = (
        np.convolve(bend > 0.02 * np.max(np.abs(t["d_anvil_rad_s"])), np.ones(9), "same") == 0.0
    )
    smooth &= (time_s > FROM_S) & (time_s < TO_S - 9 * STEP_S)
    struck = np.convolve(t["lug_torque_nm"] != 0.0, np.ones(9), "same") > 0.0
    t["motor_rad"] = np.concatenate(
        [[0.0], np.cumsum(0.5 * STEP_S * (t["speed_rad_s"][1:] + t["speed_rad_s"][:-1]))]
    )
    return t | {"time_s": time_s, "smooth": smooth, "untouched": smooth & ~struck}


def integrated(rate: Callable[[int, float], float], count: int) -> np.ndarray:
    """x' = rate(sample, x) from 0, by Euler: the states are slow."""
    x = np.zeros(count)
    for n in range(1, count):
        x[n] = x[n - 1] + STEP_S * rate(n - 1, x[n - 1])
    return x


def friction_nm(t: Trace, inertia: float = JM, constant: float | np.ndarray = K) -> np.ndarray:
    """T at the motor shaft from the balance of all that turns up to the hammer."""
    turning = (
        (JJ + N**2 * inertia) * t["d_speed_rad_s"] / N
        + JS * t["d_hammer_rad_s"]
        + t["lug_torque_nm"]
    )
    return constant * t["current_a"] - turning / N


def winding_v(t: Trace, inductance: float = L_H) -> np.ndarray:
    """Voltage across the winding, L i' + R i + k w."""
    return inductance * t["d_current_a"] + R * t["current_a"] + K * t["speed_rad_s"]


def terminal_v(t: Trace, voc: float | np.ndarray = VOC, ohm: float = RS) -> np.ndarray:
    """d Vs, Vs = Voc - Rs d i."""
    return DUTY * (voc - ohm * DUTY * t["current_a"])


def agrees(
    t: Trace, found: np.ndarray, expected: np.ndarray, scale: float, where: str = "untouched"
) -> None:
    """Found and expected agree within 0.002 `scale` in the samples `where`."""
    assert np.sum(t[where]) * STEP_S > 0.7 * (TO_S - FROM_S)
    np.testing.assert_allclose(found[t[where]], expected[t[where]], rtol=0, atol=2e-3 * scale)


def nominal_friction_nm(t: Trace) -> np.ndarray:
    return TC + B * t["speed_rad_s"]


def test_the_balances_hold_without_an_effect() -> None:
    t = motion()
    agrees(t, friction_nm(t), nominal_friction_nm(t), 0.01)
    agrees(t, winding_v(t), terminal_v(t), 0.5)


# What each effect adds to T, from the motion and its parameters.
FRICTIONS: dict[str, Callable[[Trace, dict[str, float]], np.ndarray]] = {
    "coulomb_friction": lambda t, e: e["torque_nm"] * np.sign(t["speed_rad_s"]),
    "stribeck_friction": lambda t, e: (
        e["breakaway_nm"] * np.exp(-((t["speed_rad_s"] / e["speed_rad_s"]) ** 2))
    ),
    "viscous_friction": lambda t, e: e["nm_s_per_rad"] * t["speed_rad_s"],
    "quadratic_drag": lambda t, e: (
        e["nm_s2_per_rad2"] * t["speed_rad_s"] * np.abs(t["speed_rad_s"])
    ),
    "asymmetric_friction": lambda t, e: np.full_like(t["time_s"], e["forward_nm"]),
    "directional_viscous": lambda t, e: e["nm_s_per_rad"] * np.abs(t["speed_rad_s"]),
    "cold_grease": lambda t, e: (
        e["nm_s_per_rad"] * np.exp(-t["time_s"] / e["time_s"]) * t["speed_rad_s"]
    ),
    "load_dependent_friction": lambda t, e: e["relative"] * np.abs(K * t["current_a"]),
    "cogging_torque": lambda t, e: e["torque_nm"] * np.sin(e["periods_per_rev"] * t["motor_rad"]),
    "gear_eccentricity": lambda t, e: e["torque_nm"] * np.sin(t["motor_rad"] / N),
}
# Sizes for the speeds of the impact tool, at which the term of EFFECTS is too small to measure
SIZES_AT_SPEED = {
    "stribeck_friction": {"breakaway_nm": 0.02, "speed_rad_s": 800.0},
    "quadratic_drag": {"nm_s2_per_rad2": 2e-8},
}


@pytest.mark.parametrize("effect", FRICTIONS)
def test_friction_at_the_motor_shaft(effect: str) -> None:
    values = SIZES_AT_SPEED.get(effect, EFFECTS[effect])
    t = motion(**{effect: values})
    added = FRICTIONS[effect](t, values)
    assert np.max(np.abs(added)) > 1e-3
    agrees(t, friction_nm(t) - nominal_friction_nm(t), added, 0.02)


def test_added_inertia_turns_with_the_motor() -> None:
    t = motion(added_inertia={"kg_m2": 4e-6})
    agrees(t, friction_nm(t, JM + 4e-6), nominal_friction_nm(t), 0.01)


def test_torque_constant_and_saturation_act_on_torque_and_voltage() -> None:
    for name, values, factor in (
        ("torque_constant", {"relative": -0.05}, lambda i: 0.95 + 0.0 * i),
        ("magnetic_saturation", {"saturation_a": 100.0}, lambda i: 1.0 / (1.0 + (i / 100.0) ** 2)),
    ):
        t = motion(**{name: values})
        constant = K * factor(t["current_a"])
        agrees(t, friction_nm(t, constant=constant), nominal_friction_nm(t), 0.01)
        agrees(t, winding_v(t) + (constant - K) * t["speed_rad_s"], terminal_v(t), 0.5)


# What each effect takes from d (Voc - Rs d i) before L i' + R i + k w.
VOLTAGES: dict[str, Callable[[Trace, dict[str, float]], np.ndarray]] = {
    "supply_resistance": lambda t, e: e["resistance_ohm"] * DUTY**2 * t["current_a"],
    "bridge_resistance": lambda t, e: e["resistance_ohm"] * t["current_a"],
    "winding_resistance": lambda t, e: e["relative"] * R * t["current_a"],
    "dead_time": lambda t, e: 2.0 * e["dead_time_s"] * PWM_HZ * (VOC - RS * DUTY * t["current_a"]),
    # the current is 16 A or more and its ripple 4 A, so that tanh(i / 0.3 A) is 1
    "brush_drop": lambda t, e: np.full_like(t["time_s"], e["voltage_v"]),
    "winding_heating": lambda t, e: 0.0039 * R * t["current_a"] * heat_kelvin(t, e),
    "supply_droop": lambda t, e: DUTY * droop_v(t, e),
}


def heat_kelvin(t: Trace, e: dict[str, float]) -> np.ndarray:
    """D' = kelvin_per_joule i^2 R (1 + 0.0039 D) - D / cooling_s"""
    heating = e["kelvin_per_joule"] * R * t["current_a"] ** 2
    return integrated(
        lambda n, d: heating[n] * (1.0 + 0.0039 * d) - d / e["cooling_s"], len(heating)
    )


def droop_v(t: Trace, e: dict[str, float]) -> np.ndarray:
    """volt_per_coulomb q + vp, q' = d i, vp' = (polarisation_ohm d i - vp) / polarisation_s"""
    bus_a = DUTY * t["current_a"]
    charge = integrated(lambda n, _: bus_a[n], len(bus_a))
    polarised = integrated(
        lambda n, vp: (e["polarisation_ohm"] * bus_a[n] - vp) / e["polarisation_s"], len(bus_a)
    )
    return e["volt_per_coulomb"] * charge + polarised


@pytest.mark.parametrize("effect", VOLTAGES)
def test_voltage_across_the_winding(effect: str) -> None:
    t = motion(**{effect: EFFECTS[effect]})
    lost = VOLTAGES[effect](t, EFFECTS[effect])
    assert np.max(lost[t["untouched"]]) > 0.05
    agrees(t, terminal_v(t) - winding_v(t), lost, 0.5)


def test_inductance() -> None:
    t = motion(inductance={"relative": 0.5})
    agrees(t, winding_v(t, 1.5 * L_H), terminal_v(t), 0.5)


def axial_n(t: Trace, rate: float = RATE, preload: float = F0) -> np.ndarray:
    """Force through the balls: F0 + k x + m x''; instants at the lugs' height are left out."""
    t["untouched"] &= np.abs(t["hammer_m"] - 4.5e-3) > 1.5e-4
    return preload + rate * t["hammer_m"] + MASS * t["d_hammer_m_per_s"]


def slope_m(t: Trace) -> np.ndarray:
    """s = dx / dq of the rounded vertex, q = thJ - thS."""
    q = t["motor_rad"] / N - t["hammer_rad"]
    return LEAD * q / np.hypot(q, 0.05)


def groove_nm(t: Trace) -> np.ndarray:
    """Torque through the groove, on the hammer: JS thS'' + Tlug."""
    return JS * t["d_hammer_rad_s"] + t["lug_torque_nm"]


@pytest.mark.parametrize(
    ("effect", "rate", "preload"),
    [(None, 1.0, 1.0), ("spring_rate", 1.1, 1.0), ("spring_preload", 1.0, 1.1)],
)
def test_spring(effect: str | None, rate: float, preload: float) -> None:
    t = motion(**({effect: EFFECTS[effect]} if effect else {}))
    agrees(t, groove_nm(t), slope_m(t) * axial_n(t, rate * RATE, preload * F0), 2.0)


def test_groove_friction_opposes_the_balls() -> None:
    t = motion(groove_friction={"coefficient": 0.1})
    arm = 0.1 * RADIUS / np.cos(np.arctan(LEAD / RADIUS))
    way = np.sign(t["speed_rad_s"] / N - t["hammer_rad_s"])  # of q'
    t["untouched"] &= (
        np.convolve(np.abs(np.diff(way, prepend=way[0])) > 0.0, np.ones(5), "same") == 0.0
    )
    agrees(t, groove_nm(t), (slope_m(t) + arm * way) * axial_n(t), 2.0)
    for one_way in (1.0, -1.0):
        assert np.sum(way[t["untouched"]] == one_way) > 3000


def test_lug_wear_releases_at_a_lower_height() -> None:
    """Flanks do not touch from the worn height on, and do below it."""
    for wear_m, height_m in ((0.0, 4.5e-3), (1.5e-3, 3.0e-3)):
        t = motion("locked", 0.6, lug_wear={"height_m": wear_m})
        touching = np.abs(t["lug_torque_nm"]) > 0.0
        assert np.max(t["hammer_m"][touching]) <= height_m
        assert np.max(t["hammer_m"][touching]) > 0.9 * height_m


def test_impact_damping_is_the_force_beyond_the_spring_while_approaching() -> None:
    for relative in (0.0, 0.5):
        t = motion("locked", **({"impact_damping": {"relative": relative}} if relative else {}))
        pen = 0.015 * (
            t["hammer_rad"]
            - 1.0
            - t["anvil_angle_rad"]
            - np.pi * np.round((t["hammer_rad"] - 1.0) / np.pi)
        )
        rate = 0.015 * (t["hammer_rad_s"] - t["anvil_rad_s"])
        deep = t["smooth"] & (t["lug_torque_nm"] > 0.0) & (pen > 2e-5) & (rate > 0.0)
        assert np.sum(deep) > 20
        damping = (t["lug_torque_nm"][deep] / 0.015 - 3e7 * pen[deep]) / rate[deep]
        np.testing.assert_allclose(damping, 2e3 * (1.0 + relative), rtol=2e-3)


def test_joint_stiffness_carries_the_twist() -> None:
    t = motion("locked", joint_stiffness={"relative": -0.2})
    agrees(
        t,
        t["anvil_torque_nm"],
        0.8 * 3000.0 * t["twist_rad"] + 0.3 * t["anvil_rad_s"],
        50.0,
        "smooth",
    )


def test_thread_friction_raises_the_torque_at_which_the_joint_slips() -> None:
    assert np.max(motion(thread_friction={"relative": 0.2})["anvil_torque_nm"]) == pytest.approx(
        72.0, rel=1e-9
    )


def test_a_coupler_is_a_spring_and_a_damper_before_an_inertia() -> None:
    e = EFFECTS["coupler_compliance"]
    t = motion("locked", coupler_compliance=e)
    damping = 2.0 * e["damping_ratio"] * np.sqrt(e["stiffness_nm_per_rad"] * e["inertia_kg_m2"])
    twist = t["anvil_angle_rad"] - t["head_rad"] - t["twist_rad"]
    carried = e["stiffness_nm_per_rad"] * twist + damping * np.gradient(twist, STEP_S)
    agrees(t, JA * t["d_anvil_rad_s"], t["lug_torque_nm"] - carried, 100.0, "smooth")
    second = np.gradient(np.gradient(t["anvil_angle_rad"] - twist, STEP_S), STEP_S)
    agrees(t, e["inertia_kg_m2"] * second, carried - t["anvil_torque_nm"], 100.0, "smooth")


def test_backlash_is_a_play_with_stiff_flanks_between_motor_and_spindle() -> None:
    """docs/plant.md: flanks of 8,000 rad/s and damping ratio 0.15 against the reduced inertia, at
    the motor shaft.
    """
    t = motion(gear_backlash={"play_rad": 0.02})
    reduced = JM * (JJ / N**2) / (JM + JJ / N**2)
    q = np.sqrt((t["hammer_m"] / LEAD + 0.05) ** 2 - 0.05**2)  # of the spindle, up to its sign
    ahead = t["motor_rad"] / N - t["hammer_rad"]
    e = N * (ahead - np.where(np.abs(ahead - q) < np.abs(ahead + q), q, -q))
    over = np.where(np.abs(e) > 0.01 * N, e - np.sign(e) * 0.01 * N, 0.0)
    pushed = 8000.0**2 * reduced * over + 2.0 * 0.15 * 8000.0 * reduced * np.gradient(e, STEP_S)
    gear_nm = K * t["current_a"] - nominal_friction_nm(t) - JM * t["d_speed_rad_s"]
    firm, push = t["untouched"] & (np.abs(over) > 1e-3) & (q > 0.2), pushed * np.sign(over)
    assert np.sum(firm & (push > 0.01)) > 10000
    np.testing.assert_allclose(
        gear_nm[firm & (push > 0.01)], pushed[firm & (push > 0.01)], rtol=0, atol=1e-3
    )
    # the flanks push and never pull
    assert np.sum(firm & (push < -0.01)) > 10 and np.min((gear_nm * np.sign(over))[firm]) > -0.01
    # no contact of the flanks in the neighbouring samples either
    loose = t["untouched"] & (np.abs(e) + np.abs(np.gradient(e)) < 0.01 * N) & (q > 0.2)
    assert np.sum(loose) > 50
    np.testing.assert_allclose(gear_nm[loose], 0.0, atol=1e-3)


def test_the_arm_swings_under_the_housing_reaction() -> None:
    """J_h ph'' + c ph' + k ph = T_h with 4e-3 kg m2, 0.25 N m s/rad and 25 N m/rad
    (docs/spec/model.md, section 8).
    """
    t = motion("locked")
    speed = np.gradient(t["arm_rad"], STEP_S)
    assert np.max(np.abs(t["housing_nm"])) > 1.0
    agrees(
        t,
        4e-3 * np.gradient(speed, STEP_S) + 0.25 * speed + 25.0 * t["arm_rad"],
        t["housing_nm"],
        1.0,
    )
