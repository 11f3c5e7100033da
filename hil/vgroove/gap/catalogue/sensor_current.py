"""Effects of the current sensor."""

from .common import relative, sensor_lag
from .entry import OFF_AT_INFINITY, Effect, Parameter, Scales
from .keys import POSITIVE


def _least_limit(s: Scales) -> float:
    """A clipped sensor shows no current beyond its limit, noise apart."""
    return max(0.2 * s.amp, s.shown_amp)


EFFECTS = (
    Effect(
        "current_lag",
        "sensor_current",
        "first-order filter of the current",
        (sensor_lag(),),
        needs=("current",),
        switch=("time_constant_s",),
    ),
    Effect(
        "current_gain",
        "sensor_current",
        "i (1 + relative)",
        (relative(0.03, 0.8),),
        needs=("current",),
    ),
    Effect(
        "current_offset",
        "sensor_current",
        "i + offset_a",
        (
            Parameter(
                "offset_a",
                "A",
                lambda s: 0.02 * s.amp,
                lambda s: -s.amp,
                lambda s: s.amp,
                plausible=lambda s: 0.05 * s.amp,
            ),
        ),
        needs=("current",),
    ),
    Effect(
        "current_saturation",
        "sensor_current",
        "clipped at +-limit_a",
        (
            Parameter(
                "limit_a",
                "A",
                lambda s: 0.05 * s.amp,
                _least_limit,
                lambda s: 2.0 * s.amp,
                (20.0,),
                key=POSITIVE,
                neutral=OFF_AT_INFINITY,
                widest_low=_least_limit,
            ),
        ),
        needs=("current",),
    ),
)
