"""Laws of the impact tool for all parameters: energy, momentum, climb and release torque, order of
blows, neutral effects.
"""

import numpy as np
import pytest

from test_impact_plant import HARD, LOCKED, rig_with
from vgroove import _core as core
from vgroove.rig import Rig

JOINTS = {
    "locked": LOCKED,
    "slip 60": {**HARD, "run_torque_nm": 60.0},
    "slope 700": {**HARD, "run_torque_nm": 0.3, "slip_slope_nm_per_rad": 700},
    "free": {"kind": "none"},
    "screw": {
        "kind": "wood_screw",
        "stiffness_nm_per_rad": 100,
        "damping_nm_s_per_rad": 0.3,
        "start_nm": 0.5,
        "end_nm": 6.0,
        "turns": 36,
        "seat_nm": 12.0,
        "seat_deg": 90,
        "stripped_ratio": 0.35,
        "from_turns": 34,
        "loosen_ratio": 0.6,
    },
    "discs": {
        "kind": "disc_spring",
        "stiffness_nm_per_rad": 3000,
        "damping_nm_s_per_rad": 0.3,
        "parallel": 4,
        "series": 42,
        "friction": 0.12,
        "from_turns": 4,
        "run_torque_nm": 0.3,
    },
    "pendulum": {"kind": "pendulum", "mass_kg": 0.49, "length_m": 0.1},
    "torque": {"kind": "torque"},
}
# One size of each effect that acts on the motion; the default of a parameter is its off value.
EFFECTS = {
    "supply_resistance": {"resistance_ohm": 0.05},
    "supply_droop": {"volt_per_coulomb": 0.05, "polarisation_ohm": 0.03, "polarisation_s": 0.05},
    "dead_time": {"dead_time_s": 1e-6},
    "bridge_resistance": {"resistance_ohm": 0.02},
    "winding_resistance": {"relative": 0.1},
    "winding_heating": {"kelvin_per_joule": 0.5, "cooling_s": 5.0},
    "brush_drop": {"voltage_v": 0.5},
    "inductance": {"relative": 0.2},
    "torque_constant": {"relative": -0.05},
    "magnetic_saturation": {"saturation_a": 100.0},
    "coulomb_friction": {"torque_nm": 0.01},
    "stribeck_friction": {"breakaway_nm": 0.02, "speed_rad_s": 100.0},
    "viscous_friction": {"nm_s_per_rad": 1e-5},
    "quadratic_drag": {"nm_s2_per_rad2": 1e-8},
    "asymmetric_friction": {"forward_nm": 0.01, "backward_nm": 0.0},
    "directional_viscous": {"nm_s_per_rad": 1e-5},
    "cogging_torque": {"torque_nm": 0.02, "periods_per_rev": 6.0},
    "added_inertia": {"kg_m2": 2e-6},
    "cold_grease": {"nm_s_per_rad": 2e-5, "time_s": 1.0},
    "load_dependent_friction": {"relative": 0.1},
    "gear_eccentricity": {"torque_nm": 0.01},
    "coupler_compliance": {
        "stiffness_nm_per_rad": 2000.0,
        "damping_ratio": 0.5,
        "inertia_kg_m2": 2e-5,
    },
    "gear_backlash": {"play_rad": 0.01},
    "groove_friction": {"coefficient": 0.1},
    "spring_rate": {"relative": 0.1},
    "spring_preload": {"relative": 0.1},
    "impact_damping": {"relative": 0.5},
    "lug_wear": {"height_m": 5e-4},
    "joint_stiffness": {"relative": -0.2},
    "thread_friction": {"relative": 0.2},
    "wood_knot": {"torque_nm": 20.0, "from_rad": 0.05, "to_rad": 0.08},
}


def drive(
    rig: Rig,
    duty: np.ndarray,
    mode: str = "reference",
    coast: np.ndarray | None = None,
    load_nm: float = 5.0,
    **options: object,
) -> dict:
    """The tool from rest, rows of 1 ms; a torque load is 5 N m by default."""
    time_s = np.arange(duty.size) * 1e-3
    load = np.full(duty.size, load_nm) if rig.load["kind"] == "torque" else None
    log = core.LogInput(time_s, "duty", duty, load_kind=rig.load["kind"], load_nm=load, coast=coast)
    return core.simulate_impact(log, rig.parameters()[None, :], mode=mode, **options)


def imbalance(energy: dict) -> float:
    """Largest difference between source and losses plus change of stored energy, as a share of the
    source.
    """
    spent = sum(energy[name] for name in energy if name.startswith("loss_"))
    rest = energy["work_in"] - spent - (energy["stored"] - energy["stored"][0])
    return float(np.max(np.abs(rest)) / np.max(np.abs(energy["work_in"])))


@pytest.mark.parametrize("joint", JOINTS)
def test_energy_of_every_joint_adds_up(joint: str) -> None:
    duty = np.concatenate([np.full(250, 1.0), np.full(150, 0.4), np.full(100, -0.5)])
    assert imbalance(drive(rig_with(JOINTS[joint]), duty, energy=True)["energy"]) < 1e-7


@pytest.mark.parametrize("effect", EFFECTS)
def test_energy_adds_up_with_every_effect(effect: str) -> None:
    rig = rig_with(JOINTS["slope 700"]).with_effects({effect: EFFECTS[effect]})
    assert (
        imbalance(
            drive(rig, np.concatenate([np.full(250, 0.9), np.full(50, 0.5)]), energy=True)["energy"]
        )
        < 1e-6
    )


def test_energy_adds_up_with_friction_on_the_flanks_and_a_curved_contact() -> None:
    rig = rig_with(
        JOINTS["slip 60"], mechanism__friction_static=0.15, mechanism__friction_kinetic=0.10
    )
    assert imbalance(drive(rig, np.full(300, 1.0), energy=True)["energy"]) < 1e-5
    curved = rig_with(
        LOCKED, mechanism__contact_exponent=1.5, mechanism__contact_stiffness_n_per_m=1.5e9
    )
    assert imbalance(drive(curved, np.full(300, 1.0), energy=True)["energy"]) < 1e-6


@pytest.mark.parametrize("brake", [False, True])
@pytest.mark.parametrize("joint", JOINTS)
def test_energy_never_grows_with_the_input_off(joint: str, brake: bool) -> None:
    if joint == "torque":  # a load column is a source of its own
        return
    duty, coast = np.full(500, 1.0), np.zeros(500)
    duty[300:], coast[300:] = 0.0, 0.0 if brake else 1.0
    stored = drive(rig_with(JOINTS[joint]), duty, coast=coast, energy=True)["energy"]["stored"][
        301:
    ]
    assert stored[0] > 0.05
    assert np.max(np.diff(stored)) <= 1e-9 * stored[0]
    assert stored[-1] < 0.9 * stored[0]


@pytest.mark.parametrize(
    "effect", [None, "gear_backlash", "coupler_compliance", "groove_friction", "added_inertia"]
)
def test_housing_reaction_both_ways(effect: str | None) -> None:
    rig = rig_with(JOINTS["slip 60"])
    rig = rig.with_effects({effect: EFFECTS[effect]}) if effect else rig
    trace = drive(rig, np.full(300, 1.0), trace_s=np.linspace(0.0, 0.295, 20001))["trace"]
    assert np.max(np.abs(trace["housing_nm"])) > 3.0
    largest = np.max(np.abs(trace["lug_torque_nm"]))
    np.testing.assert_allclose(
        trace["housing_nm"], trace["housing_momentum_nm"], rtol=0, atol=1e-9 * largest
    )


def integral(time_s: np.ndarray, values: np.ndarray) -> float:
    """Integral over time by the trapezoidal rule."""
    return float(np.trapezoid(values, time_s))


@pytest.mark.parametrize("joint", ["locked", "slip 60", "slope 700"])
def test_momentum_balances_at_each_blow(joint: str) -> None:
    rig = rig_with(JOINTS[joint])
    blows = drive(rig, np.full(400, 1.0))["blows"][0]
    for blow in blows[blows["kind"] == 0][3:8]:
        time_s = np.linspace(blow["time_s"] - 2e-5, blow["time_s"] + 8e-4, 40001)
        trace = drive(rig, np.full(400, 1.0), trace_s=time_s)["trace"]
        begin = np.argmax(trace["lug_torque_nm"] > 0.0)
        end = begin + np.argmax(trace["lug_torque_nm"][begin:] == 0.0)
        contact = slice(begin - 1, end + 1)
        lug = integral(time_s[contact], trace["lug_torque_nm"][contact])
        assert lug == pytest.approx(blow["impulse_nm_s"], rel=1e-4)
        joint_nms = integral(time_s[contact], trace["anvil_torque_nm"][contact])
        assert 1.2e-5 * np.diff(trace["anvil_rad_s"][contact][[0, -1]])[0] == pytest.approx(
            lug - joint_nms, abs=1e-4 * lug
        )
        turning = (
            (6e-6 + 5.6**2 * 1.6e-5) * np.diff(trace["speed_rad_s"][contact][[0, -1]])[0] / 5.6
        )
        turning += 4.5e-5 * np.diff(trace["hammer_rad_s"][contact][[0, -1]])[0]
        spindle_nm = 5.6 * (
            0.0109 * trace["current_a"][contact] - 0.012 - 4.5e-6 * trace["speed_rad_s"][contact]
        )
        assert turning == pytest.approx(integral(time_s[contact], spindle_nm) - lug, abs=1e-3 * lug)


def ramped(
    rig: Rig, seconds: float, torque_nm: float, **options: object
) -> tuple[np.ndarray, dict]:
    """Run with a spindle torque that rises from 0 to torque_nm. High viscous friction of the motor
    lets the hammer climb the groove without oscillation.
    """
    time_s = np.arange(round(seconds * 1000) + 1) * 1e-3
    current = torque_nm / (5.6 * 0.0109) * time_s / seconds
    log = core.LogInput(time_s, "current_a", current, slew_per_s=1e6, load_kind=rig.load["kind"])
    return time_s, core.simulate_impact(log, rig.parameters()[None, :], **options)


def test_climb_and_release_torque() -> None:
    """Climbs at l F0 in the limit of a sharp vertex, releases at l (F0 + k h)."""
    lead, preload, rate, height = 4.4e-3, 220.0, 29400.0, 4.5e-3
    rig = rig_with(
        LOCKED,
        mechanism__vertex_rad=1e-3,
        mechanism__hammer_start_rad=-1e-5,
        motor__coulomb_nm=0.0,
        motor__viscous_nm_s_per_rad=0.002,
    )
    fine_s = np.linspace(0.0, 4.0, 40001)
    trace = ramped(rig, 4.0, 1.2 * lead * (preload + rate * height), trace_s=fine_s)[1]["trace"]
    torque, x = trace["anvil_torque_nm"], trace["hammer_m"]
    climbs = torque[np.argmax(x > 0.01 * height)]
    assert x.max() >= height
    releases = torque[np.argmax(x >= height) - 1]
    assert climbs == pytest.approx(lead * (preload + 0.01 * rate * height), rel=0.01)
    assert releases == pytest.approx(lead * (preload + rate * height), rel=0.01)


@pytest.mark.parametrize("joint", ["locked", "slip 60", "slope 700", "screw", "discs"])
@pytest.mark.parametrize("duty", [0.3, 0.55, 0.8, 1.0])
@pytest.mark.parametrize("lugs", [2, 3])
def test_no_more_blows_than_lugs_per_relative_turn(joint: str, duty: float, lugs: int) -> None:
    rig = rig_with(
        JOINTS[joint],
        mechanism__lug_count=lugs,
        mechanism__lug_overlap_rad=1.0 if lugs == 2 else 0.7,
    )
    out = drive(rig, np.full(500, duty), trace_s=np.array([0.0, 0.498]))
    turns = np.ptp(out["trace"]["relative_rad"]) / (2 * np.pi)
    blows = int(np.sum(out["blows"][0]["kind"] == 0))
    assert 0 < blows <= lugs * turns + 1.0


def off_values(effect: str) -> dict[str, float]:
    """Parameters at which the effect is off: their defaults, or the value of EFFECTS where the
    default is infinite.
    """
    defaults = dict(zip(core.PARAMETERS, core.parameter_defaults(), strict=True))
    off = {key: float(defaults[f"effects.{effect}.{key}"]) for key in EFFECTS[effect]}
    return {
        key: value if np.isfinite(value) else EFFECTS[effect][key] for key, value in off.items()
    }


# The off value of these is infinite, which a rig file cannot hold.
AT_INFINITY = ("magnetic_saturation", "coupler_compliance")


@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("mode", ["reference", "fast"])
def test_every_effect_acts_and_is_neutral_at_its_off_value(effect: str, mode: str) -> None:
    rig = rig_with(JOINTS["slope 700"])
    duty = np.full(250, 0.9)
    plain, on = (
        drive(rig, duty, mode),
        drive(rig.with_effects({effect: EFFECTS[effect]}), duty, mode),
    )
    names = ("current_a", "speed_rad_s", "head_rad")
    changed = max(
        float(np.max(np.abs(on[name] - plain[name])) / np.max(np.abs(plain[name])))
        for name in names
    )
    assert changed > 1e-3
    if effect not in AT_INFINITY:
        off = drive(rig.with_effects({effect: off_values(effect)}), duty, mode)
        assert off["speed_rad_s"].tobytes() == plain["speed_rad_s"].tobytes()


SENSOR_EFFECTS = {
    "current_lag": {"time_constant_s": 2e-3},
    "current_gain": {"relative": 0.05},
    "current_offset": {"offset_a": 1.0},
    "current_saturation": {"limit_a": 20.0},
    "speed_gain": {"relative": 0.02},
    "supply_gain": {"relative": -0.01},
}


@pytest.mark.parametrize("effect", SENSOR_EFFECTS)
def test_sensor_effects_do_not_change_the_motion(effect: str) -> None:
    rig, duty = rig_with(JOINTS["slip 60"]), np.full(250, 0.9)
    plain, on = (
        drive(rig, duty, "fast"),
        drive(rig.with_effects({effect: SENSOR_EFFECTS[effect]}), duty, "fast"),
    )
    assert np.allclose(on["speed_rad_s"], plain["speed_rad_s"], rtol=1e-4, atol=0.1)
    i, w, v = (plain[name][0] for name in ("current_a", "speed_rad_s", "supply_v"))
    expected = {
        "current_gain": ("current_a", 1.05 * i),
        "current_offset": ("current_a", i + 1.0),
        "current_saturation": ("current_a", np.minimum(i, 20.0)),
        "speed_gain": ("speed_measured_rad_s", 1.02 * w),
        "supply_gain": ("supply_v", 0.99 * v),
    }
    if effect in expected:
        name, values = expected[effect]
        np.testing.assert_allclose(on[name][0], values, rtol=1e-9, atol=1e-9)
    else:
        assert on["current_a"].max() < plain["current_a"].max() - 1.0
        assert on["current_a"].sum() == pytest.approx(plain["current_a"].sum(), rel=0.02)


def test_a_delayed_speed_is_the_earlier_speed() -> None:
    rig, duty = rig_with(JOINTS["slip 60"]), np.full(250, 0.9)
    late = rig.with_effects(
        {
            "speed_lag": {"time_constant_s": 2.5e-3, "form": "delay"},
            "hall_eccentricity": {"amplitude_rad": 0.05},
        }
    )
    out = drive(late, duty, trace_s=np.maximum(np.arange(250) * 1e-3 - 2.5e-3, 0.0))
    angle = np.interp(np.arange(3, 249) - 2.5, np.arange(250), out["angle_rad"][0])
    eccentric = out["trace"]["speed_rad_s"][3:-1] * (1 + 0.05 * np.cos(angle))
    np.testing.assert_allclose(out["speed_measured_rad_s"][0, 3:-1], eccentric, rtol=0.02, atol=1.0)
    assert np.all(out["speed_measured_rad_s"][0, :3] == 0.0)


def test_an_averaging_speed_sensor_shows_the_turned_angle_over_its_window() -> None:
    rig, duty = rig_with(JOINTS["slip 60"]), np.full(250, 0.9)
    mean = rig.with_effects({"speed_lag": {"time_constant_s": 2.5e-3, "form": "mean"}})
    out = drive(mean, duty)
    angle = out["angle_rad"][0]
    turned = (angle[5:] - angle[:-5]) / 5e-3
    np.testing.assert_allclose(out["speed_measured_rad_s"][0, 5:], turned, rtol=1e-6, atol=1e-3)
    np.testing.assert_allclose(out["angle_measured_rad"][0], angle, rtol=1e-9, atol=1e-9)


def test_transport_delay_shifts_the_command_and_clock_skew_the_time_stamps() -> None:
    rig, duty = rig_with(LOCKED), np.concatenate([np.zeros(20), np.full(230, 0.9)])
    plain, late = (
        drive(r, duty, "fast")
        for r in (rig, rig.with_effects({"transport_delay": {"delay_s": 3e-3}}))
    )
    np.testing.assert_allclose(
        late["current_a"][0, 3:], plain["current_a"][0, :-3], rtol=1e-3, atol=1e-2
    )
    skewed = drive(rig.with_effects({"clock_skew": {"relative": 0.02}}), np.full(250, 0.9))[
        "blows"
    ][0]
    straight = drive(rig, np.full(250, 0.9))["blows"][0]
    n = min(len(skewed), len(straight))
    np.testing.assert_allclose(skewed["time_s"][:n], 1.02 * straight["time_s"][:n], rtol=1e-5)


def test_hysteresis_of_disc_springs_acts_while_loosening_only() -> None:
    rig = rig_with({**JOINTS["discs"], "from_turns": 10})
    soft = rig.with_effects({"joint_hysteresis": {"relative": 0.8}})
    forward, backward = np.full(200, 1.0), np.full(400, -1.0)
    assert drive(rig, forward)["head_rad"].tobytes() == drive(soft, forward)["head_rad"].tobytes()
    assert (
        drive(soft, backward)["head_rad"][0, -1]
        < 1.2 * drive(rig, backward)["head_rad"][0, -1]
        < 0.0
    )
