"""The catalogue of effects as hypotheses: where each acts, its parameters with unit, size, bounds
and starts, and which are relatives.

Sizes are those at which an effect shows on a log (a few per cent of the torque, voltage or current
that the log holds), so that a fit works in numbers near one on a wrist motor and on a machine axis
alike.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

FREE = 1e6


@dataclass(frozen=True)
class Scales:
    """What the log and the rig span: the units in which effects are sized (SI)."""

    volt: float
    amp: float
    speed: float
    torque: float
    inertia: float
    motor_inertia: float
    resistance: float
    coulomb: float
    viscous: float
    ratio: float
    duration: float
    interval: float
    pwm_hz: float
    supply_ohm: float
    least_delay: float = 0.0


@dataclass(frozen=True)
class Parameter:
    """One number of an effect. size, low and high are functions of Scales; starts, step (of
    differences) and least (below it the number is 0: a lag of nanoseconds makes a simulation stiff
    for nothing) are in units of size.
    """

    name: str
    unit: str
    size: Callable[[Scales], float]
    low: Callable[[Scales], float] = lambda s: -FREE
    high: Callable[[Scales], float] = lambda s: FREE
    starts: tuple[float, ...] = (0.0,)
    step: float = 0.1
    least: float = 0.0
    reported: bool = True
    of: str | None = None  # the effect whose key this number is in a rig, where it is another's


@dataclass(frozen=True)
class Effect:
    """A catalogue entry. With a phase the first parameter and the phase are fitted as sine and
    cosine amplitudes; forms are alternative settings of flat parameters that are not fitted but
    tried.
    """

    id: str
    subsystem: str
    parameters: tuple[Parameter, ...]
    phase: bool = False
    needs: tuple[str, ...] = ()
    forms: tuple[tuple[tuple[str, float], ...], ...] = ((),)

    @property
    def count(self) -> int:
        """Fitted numbers, the phase included."""
        return len(self.parameters)

    def name(self, parameter: Parameter) -> str:
        """Name of a fitted number."""
        return f"effects.{self.id}.{parameter.name}"

    def column(self, parameter: Parameter) -> str:
        """Name in the simulator's flat parameter vector."""
        return f"effects.{parameter.of or self.id}.{parameter.name}"

    def beside(self, ids: Iterable[str]) -> tuple[Parameter, ...]:
        """Parameters that are left to it beside other effects."""
        return tuple(p for p in self.parameters if p.of not in ids)


def _zero(_: Scales) -> float:
    return 0.0


def _const(value: float) -> Callable[[Scales], float]:
    return lambda s: value


def _relative(size: float, bound: float = 0.9, most: float | None = None) -> Parameter:
    return Parameter(
        "relative", "1", _const(size), _const(-bound), _const(bound if most is None else most)
    )


def _ohm(low: Callable[[Scales], float] = _zero) -> Parameter:
    return Parameter(
        "resistance_ohm", "ohm", lambda s: 0.02 * s.volt / s.amp, low, lambda s: s.volt / s.amp
    )


def _torque(
    name: str, low: Callable[[Scales], float] = lambda s: -FREE, starts: tuple[float, ...] = (0.0,)
) -> Parameter:
    return Parameter(name, "N m", lambda s: 0.03 * s.torque, low, lambda s: 2.0 * s.torque, starts)


def _viscous(low: Callable[[Scales], float], starts: tuple[float, ...] = (0.0,)) -> Parameter:
    return Parameter(
        "nm_s_per_rad",
        "N m s/rad",
        lambda s: 0.03 * s.torque / s.speed,
        low,
        lambda s: 3.0 * s.torque / s.speed,
        starts,
    )


# frequency of steel teeth in contact against both sides' inertia (E), within a factor of three
# either way
FLANK_RAD_S = 4000.0


def _flank(s: Scales) -> float:
    """Stiffness that swings with FLANK_RAD_S; where all inertia hangs on the load that of a light
    output.
    """
    return FLANK_RAD_S**2 * s.motor_inertia * max(1.0 - s.motor_inertia / s.inertia, 0.01)


# Flanks of a play: what a rig calls a coupler's spring and damper. No data sheet says how far they
# throw back (starts: 0.8, 0.7 and 0.6 of the speed), and a few per cent of that decide where in the
# play the next reversal finds the output side.
FLANKS = (
    Parameter(
        "stiffness_nm_per_rad",
        "N m/rad",
        _flank,
        lambda s: 0.1 * _flank(s),
        lambda s: 10.0 * _flank(s),
        (0.5,),
        reported=False,
        of="coupler_compliance",
    ),
    Parameter(
        "damping_ratio",
        "1",
        lambda s: 0.1 * (s.motor_inertia / s.inertia) ** 0.5,
        _const(0.002),
        _const(1.0),
        (0.7, 1.1, 1.7),
        step=0.02,
        reported=False,
        of="coupler_compliance",
    ),
)

PHASE = Parameter("phase_rad", "rad", _const(1.0), reported=False)
TIME = {"unit": "s", "low": lambda s: 0.05 * s.duration, "high": lambda s: 20.0 * s.duration}


def _time(name: str, starts: tuple[float, ...]) -> Parameter:
    return Parameter(name, size=lambda s: s.duration, starts=starts, **TIME)


def _lag(name: str, starts: tuple[float, ...] = (0.0,)) -> Parameter:
    return Parameter(
        name, "s", lambda s: 2.0 * s.interval, _zero, lambda s: 0.1, starts, least=0.01
    )


# of which the contract knows nothing: what a bridge does, S(i) at the edges of the pulse
FURTHER_FORM = "effects.dead_time.at_edges"


CATALOGUE: tuple[Effect, ...] = (
    Effect("supply_resistance", "supply", (_ohm(lambda s: -s.supply_ohm),), needs=("voltage",)),
    Effect(
        "supply_droop",
        "supply",
        (
            Parameter(
                "volt_per_coulomb", "V/C", lambda s: 0.02 * s.volt / (s.amp * s.duration), _zero
            ),
            Parameter(
                "polarisation_ohm", "ohm", lambda s: 0.02 * s.volt / s.amp, _zero, starts=(0.5,)
            ),
            _time("polarisation_s", (0.1, 0.6)),
        ),
        needs=("voltage",),
    ),
    Effect(
        "dead_time",
        "bridge",
        (
            Parameter(
                "dead_time_s", "s", lambda s: 0.01 / s.pwm_hz, _zero, lambda s: 0.2 / s.pwm_hz
            ),
        ),
        needs=("duty",),
        forms=((), ((FURTHER_FORM, 1.0),)),
    ),
    Effect(
        "winding_resistance", "motor_electrical", (_relative(0.05, most=3.0),), needs=("voltage",)
    ),
    Effect(
        "bridge_resistance",
        "bridge",
        (
            Parameter(
                "resistance_ohm",
                "ohm",
                lambda s: 0.05 * s.resistance,
                lambda s: -0.9 * s.resistance,
                lambda s: 3.0 * s.resistance,
            ),
        ),
        needs=("duty",),
    ),
    Effect(
        "winding_heating",
        "motor_electrical",
        (
            Parameter(
                "kelvin_per_joule",
                "K/J",
                lambda s: 20.0 / (s.amp**2 * s.resistance * s.duration),
                _zero,
                starts=(0.3,),
            ),
            _time("cooling_s", (0.3, 2.0, 10.0)),
        ),
        needs=("voltage",),
    ),
    Effect(
        "brush_drop",
        "motor_electrical",
        (Parameter("voltage_v", "V", lambda s: 0.02 * s.volt, _zero, lambda s: 0.5 * s.volt),),
        needs=("voltage",),
    ),
    Effect("inductance", "motor_electrical", (_relative(0.2, most=9.0),), needs=("voltage",)),
    Effect("torque_constant", "motor_electrical", (_relative(0.02, 0.5),)),
    Effect(
        "magnetic_saturation",
        "motor_electrical",
        (
            Parameter(
                "saturation_a",
                "A",
                lambda s: s.amp,
                lambda s: 0.5 * s.amp,
                lambda s: 40.0 * s.amp,
                (5.0,),
            ),
        ),
    ),
    Effect("coulomb_friction", "motor_mechanical", (_torque("torque_nm", lambda s: -s.coulomb),)),
    Effect("viscous_friction", "motor_mechanical", (_viscous(lambda s: -s.viscous),)),
    Effect(
        "stribeck_friction",
        "motor_mechanical",
        (
            _torque("breakaway_nm", _zero, (0.3,)),
            Parameter(
                "speed_rad_s",
                "rad/s",
                lambda s: 0.1 * s.speed,
                lambda s: 0.003 * s.speed,
                lambda s: 0.6 * s.speed,
                (0.2, 0.8, 2.5),
            ),
        ),
    ),
    Effect(
        "quadratic_drag",
        "motor_mechanical",
        (
            Parameter(
                "nm_s2_per_rad2", "N m s2/rad2", lambda s: 0.03 * s.torque / s.speed**2, _zero
            ),
        ),
    ),
    Effect(
        "asymmetric_friction",
        "motor_mechanical",
        (_torque("forward_nm"), _torque("backward_nm")),
        needs=("both",),
    ),
    Effect(
        "directional_viscous", "motor_mechanical", (_viscous(lambda s: -FREE),), needs=("both",)
    ),
    Effect(
        "cold_grease",
        "motor_mechanical",
        (
            _viscous(_zero, (0.3,)),
            Parameter(
                "time_s",
                "s",
                lambda s: s.duration,
                lambda s: 0.03 * s.duration,
                lambda s: 3.0 * s.duration,
                (0.15, 0.6),
            ),
        ),
    ),
    Effect(
        "added_inertia",
        "motor_mechanical",
        (
            Parameter(
                "kg_m2",
                "kg m2",
                lambda s: 0.05 * s.inertia,
                lambda s: -0.9 * s.motor_inertia,
                lambda s: 20.0 * s.inertia,
            ),
        ),
    ),
    Effect(
        "cogging_torque",
        "motor_mechanical",
        (
            _torque("torque_nm"),
            Parameter(
                "periods_per_rev",
                "1",
                _const(1.0),
                _const(0.2),
                _const(1e5),
                (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0),
                step=0.002,
            ),
            PHASE,
        ),
        phase=True,
    ),
    Effect(
        "load_dependent_friction",
        "gearbox",
        (Parameter("relative", "1", _const(0.05), _zero, _const(2.0)),),
        needs=("load",),
    ),
    Effect(
        "gear_eccentricity", "gearbox", (_torque("torque_nm"), PHASE), phase=True, needs=("gear",)
    ),
    Effect(
        "coupler_compliance",
        "gearbox",
        (
            Parameter(
                "stiffness_nm_per_rad",
                "N m/rad",
                lambda s: s.inertia * 100.0**2,
                lambda s: s.inertia * 10.0**2,
                lambda s: s.inertia * 3000.0**2,
                tuple(0.02 * 1.4**n for n in range(20)),
            ),
            Parameter("damping_ratio", "1", _const(0.05), _const(0.002), _const(1.0), (1.0,)),
            Parameter(
                "inertia_kg_m2",
                "kg m2",
                lambda s: 0.1 * s.inertia,
                _zero,
                lambda s: 20.0 * s.inertia,
                (0.02, 1.0),
            ),
        ),
    ),
    Effect(
        "gear_backlash",
        "gearbox",
        (
            Parameter(
                "play_rad",
                "rad",
                _const(0.02),
                _zero,
                _const(1.0),
                tuple(0.25 * 1.25**n for n in range(23)),
            ),
            *FLANKS,
        ),
        needs=("output",),
    ),
    Effect("current_lag", "sensor_current", (_lag("time_constant_s"),), needs=("current",)),
    Effect("current_gain", "sensor_current", (_relative(0.03, 0.8),), needs=("current",)),
    Effect(
        "current_offset",
        "sensor_current",
        (Parameter("offset_a", "A", lambda s: 0.02 * s.amp, lambda s: -s.amp, lambda s: s.amp),),
        needs=("current",),
    ),
    Effect(
        "current_saturation",
        "sensor_current",
        (
            Parameter(
                "limit_a",
                "A",
                lambda s: 0.05 * s.amp,
                lambda s: 0.2 * s.amp,
                lambda s: 2.0 * s.amp,
                (20.0,),
            ),
        ),
        needs=("current",),
    ),
    Effect("speed_gain", "sensor_speed", (_relative(0.02, 0.5),), needs=("speed",)),
    Effect(
        "speed_lag",
        "sensor_speed",
        (_lag("time_constant_s"),),
        needs=("speed",),
        forms=((), (("effects.speed_lag.delay_form", 1.0),)),
    ),
    Effect(
        "hall_eccentricity",
        "sensor_speed",
        (Parameter("amplitude_rad", "rad", _const(0.02), high=_const(0.5)), PHASE),
        phase=True,
        needs=("edges",),
    ),
    Effect(
        "hall_dropout",
        "sensor_speed",
        (Parameter("probability", "1", _const(0.01), _zero, _const(0.5), (1.0,)),),
        needs=("edges",),
    ),
    Effect("supply_gain", "sensor_supply", (_relative(0.02, 0.5),), needs=("supply",)),
    Effect(
        "transport_delay",
        "timing",
        (
            Parameter(
                "delay_s",
                "s",
                lambda s: 2.0 * s.interval,
                lambda s: s.least_delay,
                _const(0.1),
                (0.0, 4.0),
            ),
        ),
    ),
    Effect(
        "clock_skew",
        "timing",
        (Parameter("relative", "1", _const(0.01), _const(-0.05), _const(0.05)),),
        forms=((), (("effects.clock_skew.command_clock", 1.0),)),
    ),
)
BY_ID = {effect.id: effect for effect in CATALOGUE}
ORDER = {effect.id: rank for rank, effect in enumerate(CATALOGUE)}

# General effects and the special cases they hold (as a limit): a rival that only generalises the
# selected effect is no rival.
SPECIAL_CASES: dict[str, tuple[str, ...]] = {
    "asymmetric_friction": ("coulomb_friction",),
    "stribeck_friction": ("coulomb_friction",),
    "supply_droop": ("supply_resistance",),
    "cold_grease": ("viscous_friction",),
    "coupler_compliance": ("added_inertia",),
    "cogging_torque": ("gear_eccentricity",),
}

# Laws of one torque over speed: sums of some of them are others of slightly different form.
FRICTION_LAWS = frozenset(
    {"coulomb_friction", "viscous_friction", "stribeck_friction", "quadratic_drag"}
)

# Equations that an effect enters: those of its subsystem but for a few.
EQUATIONS = {
    "supply": ("voltage",),
    "bridge": ("voltage",),
    "motor_electrical": ("voltage",),
    "motor_mechanical": ("torque",),
    "gearbox": ("torque",),
    "timing": ("command",),
}
MORE_EQUATIONS = {
    "torque_constant": ("voltage", "torque"),
    "magnetic_saturation": ("voltage", "torque"),
    "inductance": ("voltage", "command"),
    "clock_skew": ("voltage", "torque", "command", "sensor_speed"),
}

SENSORS = frozenset(e.subsystem for e in CATALOGUE if e.subsystem.startswith("sensor_"))

# Of two effects that predict a log alike these are the less likely: clocks seldom run off, dead
# time is known from the design.
RARE = (
    "clock_skew",
    "dead_time",
    "inductance",
    "magnetic_saturation",
    "coupler_compliance",
    "supply_gain",
)


def equations(effect_id: str) -> frozenset[str]:
    """Equations of the model that an effect enters; a sensor's is its own."""
    subsystem = BY_ID[effect_id].subsystem
    return frozenset(MORE_EQUATIONS.get(effect_id, EQUATIONS.get(subsystem, (subsystem,))))


def reached(effect_id: str) -> frozenset[str]:
    """Equations in which an effect of another form may look like one more: its own, and the
    sensors', who see all but one another.
    """
    return (
        equations(effect_id)
        if BY_ID[effect_id].subsystem in SENSORS
        else equations(effect_id) | SENSORS
    )


def equivalents(effect_id: str, kinds: frozenset[str]) -> tuple[str, ...]:
    """Other members of the effect's class that no run with these columns can tell from it (contract
    section 3).
    """
    classes = [("winding_resistance", "bridge_resistance")]
    if "current_input" in kinds:
        classes += [("torque_constant", "current_gain")]
    return tuple(
        other for group in classes if effect_id in group for other in group if other != effect_id
    )


def contains(general: tuple[str, ...], special: tuple[str, ...]) -> bool:
    """True when the general set holds the special one: equal, or some members generalise members of
    it, or it has more of them.
    """
    rest = list(special)
    for effect in general:
        covered = next((s for s in rest if s == effect or s in SPECIAL_CASES.get(effect, ())), None)
        if covered is not None:
            rest.remove(covered)
    return not rest


def available(kinds: frozenset[str], without: frozenset[str] = frozenset()) -> list[Effect]:
    """Catalogue members that can act on the given kind of log; equivalence classes are fitted
    through their first member.
    """
    chosen = [e for e in CATALOGUE if e.id not in without and set(e.needs) <= kinds]
    present = {e.id for e in chosen}
    return [
        e
        for e in chosen
        if not any(o in present and ORDER[o] < ORDER[e.id] for o in equivalents(e.id, kinds))
    ]


def span(values: np.ndarray, fallback: float) -> float:
    """Robust largest magnitude (99th percentile) of a column, the fallback where it says nothing."""
    good = np.abs(values[np.isfinite(values)])
    top = float(np.percentile(good, 99)) if good.size else 0.0
    return top if top > 1e-12 else fallback
