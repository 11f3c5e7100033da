"""Parameters that several effects share: a relative change, a resistance, a torque, a lag.

"Sized as" states the typical size, Parameter.size.
"""

from dataclasses import replace

from .entry import (
    NO_LOWER_BOUND,
    ZERO,
    OfScales,
    Parameter,
    Scales,
    constant,
)
from .keys import ANY, NOT_NEGATIVE, POSITIVE, RELATIVE

FARTHEST = 20.0  # factor between a value of the rig and the same value of any tool of its kind
PHASE = Parameter("phase_rad", "rad", constant(1.0), reported=False, key=ANY.optional())


def relative(
    size: float, bound: float = 0.9, high: float | None = None, plausible: float = 0.1
) -> Parameter:
    """A factor 1 + relative on a value of the rig, searched within +-bound, or up to high. At a
    factor of 1 / FARTHEST or FARTHEST the model has lost the value: a fit that ends there has found
    no size.
    """
    return Parameter(
        "relative",
        "1",
        constant(size),
        constant(-bound),
        constant(bound if high is None else high),
        key=RELATIVE,
        widest_low=constant(1.0 / FARTHEST - 1.0),
        widest_high=constant(FARTHEST - 1.0),
        plausible=constant(plausible),
    )


def series_resistance(low: OfScales = ZERO) -> Parameter:
    """A series resistance; its typical size drops 2 % of the voltage at the logged current."""
    return Parameter(
        "resistance_ohm",
        "ohm",
        lambda s: 0.02 * s.volt / s.amp,
        low,
        lambda s: s.volt / s.amp,
        physical="low",
        plausible=lambda s: 0.1 * s.volt / s.amp,
    )


def friction(
    name: str = "torque_nm", low: OfScales = NO_LOWER_BOUND, starts: tuple[float, ...] = (0.0,)
) -> Parameter:
    """A torque of dry friction. That of a small gear motor is often a third of the driving torque,
    that of a tool with impact mechanism, whose joint takes most of it, about a tenth.
    """
    return replace(
        torque(name, low, starts),
        plausible=lambda s: (0.1 if s.hammering else 0.3) * s.torque + 2.0 * s.coulomb,
    )


def torque(
    name: str = "torque_nm", low: OfScales = NO_LOWER_BOUND, starts: tuple[float, ...] = (0.0,)
) -> Parameter:
    """A torque, sized as 3 % of the logged motor torque."""
    return Parameter(
        name,
        "N m",
        lambda s: 0.03 * s.torque,
        low,
        lambda s: 2.0 * s.torque,
        starts,
        physical="low",
        plausible=lambda s: 0.1 * s.torque + 2.0 * s.coulomb,
    )


def viscous(low: OfScales = NO_LOWER_BOUND, starts: tuple[float, ...] = (0.0,)) -> Parameter:
    """A viscous coefficient, sized as 3 % of the logged motor torque over the logged speed."""
    return Parameter(
        "nm_s_per_rad",
        "N m s/rad",
        lambda s: 0.03 * s.torque / s.speed,
        low,
        lambda s: 3.0 * s.torque / s.speed,
        starts,
        physical="low",
        plausible=lambda s: 0.1 * s.torque / s.speed + 2.0 * s.viscous,
    )


LONGEST = 20.0  # longest time constant of a slow state, in durations of the log


def time_constant(
    name: str, starts: tuple[float, ...], neutral: float = 1.0, shortest_s: float = 0.0
) -> Parameter:
    """A time constant, sized as the log's duration; shortest_s: none is shorter in practice."""
    return Parameter(
        name,
        "s",
        lambda s: s.duration,
        lambda s: max(0.05 * s.duration, shortest_s),
        lambda s: LONGEST * max(s.duration, shortest_s),
        starts,
        key=POSITIVE,
        neutral=neutral,
        widest_low=constant(shortest_s),
    )


def longest_delay(s: Scales) -> float:
    """Upper bound of delays and lags in s: 0.1 s, or 32 row intervals of a slow logger, and at most
    a tenth of the log.
    """
    return min(max(0.1, 32.0 * s.interval), 0.1 * s.duration)


def sensor_lag() -> Parameter:
    """Time constant of a sensor, sized as two row intervals."""
    return Parameter(
        "time_constant_s",
        "s",
        lambda s: 2.0 * s.interval,
        ZERO,
        longest_delay,
        zero_below=0.01,
        key=NOT_NEGATIVE,
        plausible=lambda s: max(0.005, 3.0 * s.interval),
    )
