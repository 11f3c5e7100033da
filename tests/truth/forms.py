"""Functional forms of the effects other than the catalogue's, as a real tool may have them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from rigs import Rig


@dataclass(frozen=True)
class Level:
    """Operating level of a tool on a profile: RMS of current and speed of its effect-free run."""

    current_a: float
    speed_rad_s: float


Form = Callable[[Rig, dict[str, float], Level, np.random.Generator], dict[str, float]]


def off_one(rng: np.random.Generator, low: float, high: float, around: float = 1.0) -> float:
    """A power that differs from `around` by low .. high, with a random sign."""
    return around + float(rng.choice([-1.0, 1.0])) * float(rng.uniform(low, high))


def _supply(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    extra = made["supply_resistance_ohm"] - rig.supply_resistance_ohm
    return {
        "extra_source_ohm": extra,
        "source_power": off_one(rng, 0.05, 0.2, 0.0),
        "reference_a": level.current_a,
    }


def _droop(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    """Polarisation with two time constants: electrode surface and diffusion."""
    part = float(rng.uniform(0.25, 0.45))
    return made | {
        "polarisation_ohm": made["polarisation_ohm"] * (1.0 - part),
        "polarisation2_ohm": made["polarisation_ohm"] * part,
        "polarisation2_s": made["polarisation_s"] * float(rng.uniform(3.0, 6.0)),
    }


def _winding(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    extra = made["resistance_ohm"] - rig.resistance_ohm
    return {
        "extra_ohm": extra,
        "extra_ohm_power": float(rng.uniform(0.05, 0.15)),
        "reference_a": level.current_a,
    }


def _bridge(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    return {
        "extra_ohm": made["bridge_resistance_ohm"],
        "extra_ohm_power": -float(rng.uniform(0.05, 0.15)),
        "reference_a": level.current_a,
    }


def _dead(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    return made | {"dead_knee_a": level.current_a * float(rng.uniform(0.04, 0.12))}


def _brush(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    return made | {"brush_knee_a": float(rng.uniform(0.1, 0.6))}


def _inductance(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    extra = made["inductance_h"] - rig.inductance_h
    return {
        "extra_inductance_h": extra,
        "inductance_knee_a": level.current_a * float(rng.uniform(2.0, 4.0)),
    }


def _flux(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    """A magnet of another strength that saturates slightly."""
    size = abs(made["torque_constant_nm_per_a"] / rig.torque_constant_nm_per_a - 1.0)
    return made | {"saturation_a": level.current_a / (float(rng.uniform(0.03, 0.1)) * size) ** 0.5}


def _coulomb(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    return {
        "power_coulomb_nm": made["coulomb_nm"] - rig.coulomb_nm,
        "coulomb_power": float(rng.uniform(0.04, 0.12)),
        "reference_rad_s": level.speed_rad_s,
    }


def _viscous(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    extra = made["viscous_nm_s_per_rad"] - rig.viscous_nm_s_per_rad
    return {
        "extra_viscous_nm_s": extra,
        "viscous_power": off_one(rng, 0.06, 0.18),
        "reference_rad_s": level.speed_rad_s,
    }


def _lag(first: str, second: str) -> Form:
    def two_stages(
        rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
    ) -> dict[str, float]:
        part = float(rng.uniform(0.15, 0.4))
        return (
            made | {first: made[first] * (1.0 - part), second: made[first] * part}
            if first in made
            else made
        )

    return two_stages


def _grown(key: str, low: float, high: float, around: float = 1.0) -> Form:
    """A power of the speed that differs from the catalogue's."""
    return lambda rig, made, level, rng: (
        made | {key: off_one(rng, low, high, around), "reference_rad_s": level.speed_rad_s}
    )


def _drawn(**ranges: tuple[float, float]) -> Form:
    """Additional parameters, each drawn from its range."""
    return lambda rig, made, level, rng: (
        made | {key: float(rng.uniform(*ends)) for key, ends in ranges.items()}
    )


def _grease(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    return made | {
        "grease_tail": float(rng.uniform(0.1, 0.25)),
        "grease_tail_s": made["grease_s"] * float(rng.uniform(3.0, 6.0)),
    }


def _coupler(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    """A spring that stiffens by a fifth at the torque of the RMS current."""
    twist = level.current_a * rig.torque_constant_nm_per_a / made["coupler_nm_per_rad"]
    return made | {"coupler_cubic_per_rad2": float(rng.uniform(0.05, 0.2)) / twist**2}


def _gain(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    return made | {
        "current_gain_bend": off_one(rng, 0.04, 0.12, 0.0),
        "reference_a": level.current_a,
    }


def _delay(
    rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    return made | {"transport_jitter_s": made["transport_delay_s"] * float(rng.uniform(0.1, 0.3))}


FORMS: dict[str, Form] = {
    "supply_resistance": _supply,
    "supply_droop": _droop,
    "winding_resistance": _winding,
    "bridge_resistance": _bridge,
    "dead_time": _dead,
    "brush_drop": _brush,
    "inductance": _inductance,
    "torque_constant": _flux,
    "coulomb_friction": _coulomb,
    "viscous_friction": _viscous,
    "winding_heating": _drawn(heating_housing_share=(0.3, 0.6)),
    "stribeck_friction": _drawn(stribeck_power=(0.8, 1.6)),
    "quadratic_drag": _grown("quadratic_power", 0.1, 0.25, 2.0),
    "directional_viscous": _grown("directional_power", 0.06, 0.18),
    "cogging_torque": _drawn(cogging_second=(0.15, 0.35), cogging_third=(0.05, 0.2)),
    "cold_grease": _grease,
    "load_dependent_friction": _drawn(load_friction_power=(1.06, 1.2)),
    "gear_eccentricity": _drawn(eccentricity_second=(0.15, 0.35)),
    "coupler_compliance": _coupler,
    "current_lag": _lag("current_lag_s", "current_lag2_s"),
    "current_gain": _gain,
    "current_saturation": _drawn(current_limit_power=(8.0, 20.0)),
    "speed_lag": _lag("speed_lag_s", "speed_lag2_s"),
    "hall_eccentricity": _drawn(hall_second=(0.15, 0.35)),
    "hall_dropout": _drawn(hall_burst=(0.2, 0.5)),
    "transport_delay": _delay,
}


def other_form(
    effect_id: str, rig: Rig, made: dict[str, float], level: Level, rng: np.random.Generator
) -> dict[str, float]:
    """An effect's parameters `made` in another form; effects with a single form (an inertia, an
    offset) are unchanged.
    """
    form = FORMS.get(effect_id)
    return form(rig, made, level, rng) if form else made
