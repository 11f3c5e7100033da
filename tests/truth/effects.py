"""Effects of a generated tool, of the catalogue and outside it, each with one size in physical
units.

The list is independent of the diagnosis' catalogue by design.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from rigs import Rig

# Keys of an effect that belong to the logger; all others are parameters of the tool (params.hpp).
LOGGER_KEYS = (
    "speed_gain",
    "speed_lag_s",
    "speed_lag2_s",
    "speed_delay_s",
    "clock_skew",
    "command_skew",
)
Made = Callable[[Rig, float, np.random.Generator], dict[str, float]]


@dataclass(frozen=True)
class Effect:
    """An effect: `make(rig, size, rng)` are its changed parameters, `start_size(rig)` a size near
    the visible limit, `top(rig)` the largest plausible size.

    signed: the size may be negative. needs: property of the profile that shows it (two_way, load,
    slow). first: in the default list of make_cases.py. accept: equivalent ids. one_way: the id that
    it is equivalent to on a log in one direction.
    """

    id: str
    make: Made
    start_size: Callable[[Rig], float]
    top: Callable[[Rig], float]
    signed: bool = False
    needs: str = ""
    first: bool = False
    accept: tuple[str, ...] = ()
    one_way: str = ""


def plain(key: str) -> Made:
    """An effect whose size is one parameter of the tool."""
    return lambda rig, size, rng: {key: size}


def _relative(key: str) -> Made:
    return lambda rig, size, rng: {key: getattr(rig, key) * (1.0 + size)}


def _added(key: str) -> Made:
    return lambda rig, size, rng: {key: getattr(rig, key) + size}


def const(value: float) -> Callable[[Rig], float]:
    """A size that is the same for all tools."""
    return lambda rig: value


def _coulomb(part: float) -> Callable[[Rig], float]:
    return lambda rig: part * rig.coulomb_nm


def _viscous(part: float) -> Callable[[Rig], float]:
    return lambda rig: part * rig.viscous_nm_s_per_rad


def top_speed(rig: Rig) -> float:
    """No-load speed in rad/s, losses left out."""
    return rig.voltage_v / rig.torque_constant_nm_per_a


def shaft_inertia(rig: Rig) -> float:
    return rig.inertia_kg_m2 + rig.output_inertia_kg_m2 / rig.ratio**2


def _droop(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {
        "droop_volt_per_coulomb": size,
        "polarisation_ohm": size * rng.uniform(0.5, 3.0),
        "polarisation_s": rng.uniform(0.4, 2.0),
    }


def _stribeck(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"breakaway_nm": size, "stribeck_rad_s": rng.uniform(0.05, 0.15) * top_speed(rig)}


def _asymmetric(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"forward_nm": size, "backward_nm": size * float(rng.choice([-1.0, -0.5, 0.0]))}


def cogging(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    """A ripple torque of amplitude `size` with a drawn number of periods a turn, and its phase."""
    return {
        "cogging_nm": size,
        "cogging_per_rev": float(rng.choice([1, 2, 4, 6])),
        "cogging_phase_rad": rng.uniform(0, 6.28),
    }


def _grease(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"grease_nm_s": size, "grease_s": rng.uniform(0.6, 2.5)}


def _coupler(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    inertia = float(rng.uniform(0.0, 0.05)) * rig.inertia_kg_m2 * min(size / 10.0, 1.0)
    return {
        "coupler_nm_per_rad": min(1.0 / size, 50.0),
        "coupler_damping_ratio": rng.uniform(0.05, 0.2),
        "coupler_inertia_kg_m2": inertia,
    }


def _heating(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {
        "heating_kelvin_per_joule": size,
        "heating_cooling_s": rng.uniform(4.0, 20.0),
        "heating_housing_share": rng.uniform(0.1, 0.3),
    }


def speed_lag(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    """A filter or a delay of the time `size`, drawn."""
    return {"speed_lag_s" if rng.uniform() < 0.5 else "speed_delay_s": size}


def _skew(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"command_skew" if rng.uniform() < 0.5 else "clock_skew": size}


def with_phase(key: str, phase: str) -> Made:
    """An effect whose size is one parameter of the tool, with a drawn phase in rad."""
    return lambda rig, size, rng: {key: size, phase: rng.uniform(0, 6.28)}


def _gated(key: str) -> Made:
    return lambda rig, size, rng: {
        key: size,
        "gate_on_s": rng.uniform(0.08, 0.2),
        "gate_off_s": rng.uniform(0.25, 0.6),
    }


def _glitch(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {
        "u_glitch": size,
        "gate_on_s": rng.uniform(0.004, 0.012),
        "gate_off_s": rng.uniform(0.1, 0.3),
    }


def _tight(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    """A tight spot that repeats only every few dozen turns of the output, as on a drum or a lead
    screw.
    """
    every = 2 * np.pi * rng.uniform(12.0, 30.0)
    at = rng.uniform(0.2, 0.9) * every
    return {
        "u_tight_nm": size,
        "u_tight_every_rad": every,
        "u_tight_width_rad": 0.09 * every,
        "u_tight_at_rad": at,
    }


def _wander(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"u_wander_nm": size, "u_wander_s": rng.uniform(0.9, 1.8)}


def _torque_hum(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"u_torque_hum_nm": size, "u_torque_hz": rng.uniform(2.0, 12.0)}


def _ripple(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {
        "u_ripple_nm": size,
        "u_ripple_per_rev": rng.uniform(0.05, 0.2),
        "u_ripple_wander": rng.uniform(0.8, 2.0),
    }


def _hum(rig: Rig, size: float, rng: np.random.Generator) -> dict[str, float]:
    return {"u_hum_a": size, "u_hum_hz": float(rng.choice([50.0, 60.0, 100.0]))}


_R = ("winding_resistance", "bridge_resistance")
CATALOGUE = tuple(
    Effect(*row[:4], **row[4])
    for row in (
        (
            "supply_resistance",
            _added("supply_resistance_ohm"),
            const(1e-3),
            lambda r: 0.6 * r.resistance_ohm,
            {"first": True},
        ),
        (
            "winding_resistance",
            _relative("resistance_ohm"),
            const(0.01),
            const(0.8),
            {"first": True, "accept": _R, "signed": True},
        ),
        (
            "bridge_resistance",
            plain("bridge_resistance_ohm"),
            lambda r: 0.01 * r.resistance_ohm,
            lambda r: 0.8 * r.resistance_ohm,
            {"first": True, "accept": _R},
        ),
        (
            "brush_drop",
            plain("brush_drop_v"),
            const(0.01),
            lambda r: 0.12 * r.voltage_v,
            {"first": True},
        ),
        (
            "torque_constant",
            _relative("torque_constant_nm_per_a"),
            const(1e-3),
            const(0.25),
            {"first": True, "signed": True},
        ),
        ("coulomb_friction", _added("coulomb_nm"), _coulomb(0.02), _coulomb(2.5), {"first": True}),
        (
            "viscous_friction",
            _added("viscous_nm_s_per_rad"),
            _viscous(0.05),
            _viscous(6.0),
            {"first": True},
        ),
        (
            "asymmetric_friction",
            _asymmetric,
            _coulomb(0.02),
            _coulomb(0.9),
            {"first": True, "needs": "two_way", "one_way": "coulomb_friction"},
        ),
        (
            "directional_viscous",
            plain("directional_viscous_nm_s"),
            _viscous(0.05),
            _viscous(3.0),
            {"first": True, "signed": True, "needs": "two_way", "one_way": "viscous_friction"},
        ),
        (
            "stribeck_friction",
            _stribeck,
            _coulomb(0.05),
            _coulomb(2.5),
            {"first": True, "needs": "slow"},
        ),
        (
            "quadratic_drag",
            plain("quadratic_nm_s2"),
            lambda r: 0.02 * r.coulomb_nm / top_speed(r) ** 2,
            lambda r: 3.0 * r.coulomb_nm / top_speed(r) ** 2,
            {"first": True},
        ),
        (
            "added_inertia",
            _added("inertia_kg_m2"),
            lambda r: 0.005 * shaft_inertia(r),
            lambda r: 0.45 * shaft_inertia(r),
            {"first": True, "signed": True},
        ),
        (
            "current_offset",
            plain("current_offset_a"),
            const(0.1),
            const(4.0),
            {"first": True, "signed": True},
        ),
        (
            "current_gain",
            plain("current_gain"),
            const(0.03),
            const(0.4),
            {"first": True, "signed": True},
        ),
        (
            "transport_delay",
            plain("transport_delay_s"),
            const(2e-4),
            const(0.03),
            {"first": True},
        ),
        ("supply_droop", _droop, const(2e-3), const(0.2), {}),
        ("dead_time", plain("dead_time_s"), const(2e-8), const(2e-6), {}),
        ("winding_heating", _heating, const(0.02), const(4.0), {}),
        ("inductance", _relative("inductance_h"), const(0.2), const(1.5), {}),
        (
            "magnetic_saturation",
            lambda rig, size, rng: {"saturation_a": size**-0.5},
            const(2e-5),
            const(5e-3),
            {"needs": "load"},
        ),
        ("cogging_torque", cogging, _coulomb(0.1), _coulomb(3.0), {}),
        ("cold_grease", _grease, _viscous(0.1), _viscous(10.0), {}),
        (
            "load_dependent_friction",
            plain("load_friction"),
            const(0.01),
            const(0.6),
            {"needs": "load"},
        ),
        (
            "gear_eccentricity",
            with_phase("eccentricity_nm", "eccentricity_phase_rad"),
            _coulomb(0.05),
            _coulomb(1.0),
            {},
        ),
        ("coupler_compliance", _coupler, const(0.3), const(60.0), {}),
        ("gear_backlash", plain("play_rad"), const(0.02), const(0.5), {"needs": "two_way"}),
        ("current_lag", plain("current_lag_s"), const(1e-3), const(0.08), {}),
        (
            "current_saturation",
            lambda rig, size, rng: {"current_limit_a": 1.0 / size},
            const(0.05),
            const(1.0),
            {},
        ),
        ("speed_gain", plain("speed_gain"), const(5e-4), const(0.2), {"signed": True}),
        ("speed_lag", speed_lag, const(5e-4), const(0.08), {}),
        (
            "hall_eccentricity",
            with_phase("hall_eccentricity_rad", "hall_eccentricity_phase_rad"),
            const(5e-4),
            const(0.3),
            {},
        ),
        ("hall_dropout", plain("hall_dropout"), const(3e-3), const(0.2), {}),
        ("supply_gain", plain("supply_gain"), const(1e-3), const(0.15), {"signed": True}),
        ("clock_skew", _skew, const(1e-3), const(0.05), {"signed": True}),
    )
)
# Outside the catalogue: effects that come and go or vary with time; no constant term of the
# catalogue explains most of such an effect.
OUTSIDE = tuple(
    Effect(*row)
    for row in (
        ("u_load_comes_and_goes", _gated("u_load_nm"), _coulomb(0.05), _coulomb(8.0)),
        (
            "u_brush_contact",
            _gated("u_brush_ohm"),
            lambda r: 0.05 * r.resistance_ohm,
            lambda r: 20.0 * r.resistance_ohm,
        ),
        (
            "u_battery_contact",
            _gated("u_contact_ohm"),
            lambda r: 0.05 * r.resistance_ohm,
            lambda r: 10.0 * r.resistance_ohm,
        ),
        ("u_duty_glitches", _glitch, const(0.05), const(1.0)),
        ("u_tight_spot", _tight, _coulomb(0.1), _coulomb(6.0)),
        ("u_wandering_friction", _wander, _coulomb(0.05), _coulomb(0.95)),
        ("u_loose_magnet", _gated("u_flux_loss"), const(2e-3), const(0.3)),
        ("u_torque_hum", _torque_hum, _coulomb(0.05), _coulomb(2.0)),
        ("u_random_ripple", _ripple, _coulomb(0.05), _coulomb(3.0)),
        ("u_mains_hum", _hum, const(0.2), const(8.0)),
    )
)
OUTSIDE_IDS = tuple(effect.id for effect in OUTSIDE)
BY_ID = {effect.id: effect for effect in (*CATALOGUE, *OUTSIDE)}
FIRST = tuple(effect.id for effect in CATALOGUE if effect.first)


def accepted(effect: Effect, two_way: bool) -> list[str]:
    """Ids that are right answers for an effect: its equivalents, also those on a log in one
    direction.
    """
    ids = list(effect.accept) or [effect.id]
    if effect.one_way and not two_way:
        ids.append(effect.one_way)
    return sorted(ids)


def split(params: dict[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """(parameters of the tool, settings of the logger)."""
    return (
        {key: value for key, value in params.items() if key not in LOGGER_KEYS},
        {key: value for key, value in params.items() if key in LOGGER_KEYS},
    )
