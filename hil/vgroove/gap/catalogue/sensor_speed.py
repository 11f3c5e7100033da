"""Effects of the speed sensor."""

from .common import PHASE, relative, sensor_lag
from .entry import ZERO, Effect, Form, Parameter, Periodic, constant
from .keys import PROBABILITY

EFFECTS = (
    Effect(
        "speed_gain",
        "sensor_speed",
        "w (1 + relative)",
        (relative(0.02, 0.5, plausible=0.05),),
        needs=("speed",),
    ),
    Effect(
        "speed_lag",
        "sensor_speed",
        "first-order filter, pure delay of time_constant_s, or mean over 2 time_constant_s",
        (sensor_lag(),),
        needs=("speed",),
        form=Form("form", ("filter", "delay", "mean"), "lag_form", ("mean",), of_rows=("mean",)),
    ),
    Effect(
        "hall_eccentricity",
        "sensor_speed",
        "measured angle th + amplitude_rad sin(th + phase_rad)",
        (
            Parameter(
                "amplitude_rad",
                "rad",
                constant(0.02),
                high=constant(0.5),
                physical="high",  # at 1 rad the measured angle runs backwards
                plausible=constant(0.1),
            ),
            PHASE,
        ),
        needs=("motion",),
        periodic=Periodic("amplitude_rad", 1.0, moves_shaft=False),
        remark="a once-per-turn error of measured speed and angle, not of the shaft",
        switch=("amplitude_rad",),
    ),
    Effect(
        "hall_dropout",
        "sensor_speed",
        "each edge is missed with this probability, independently of the others",
        (
            Parameter(
                "probability",
                "1",
                constant(0.01),
                ZERO,
                constant(0.5),
                (1.0,),
                key=PROBABILITY,
                physical="both",
            ),
        ),
        needs=("edges",),
        remark="the speed over a missed edge is too low by a whole factor",
        counted=True,
    ),
)
