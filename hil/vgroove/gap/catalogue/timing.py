"""Effects of the clocks: a late command, a clock that runs fast or slow."""

from .common import longest_delay
from .entry import Effect, Form, Parameter, Separation, constant
from .keys import NOT_NEGATIVE, SKEW

EFFECTS = (
    Effect(
        "transport_delay",
        "timing",
        "the column that drives the model acts delay_s later than logged",
        (
            Parameter(
                "delay_s",
                "s",
                lambda s: 2.0 * s.interval,
                lambda s: s.least_delay,
                longest_delay,
                (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 9.0, 13.0),
                step=0.5,  # a row: within it the rows of a motor that settles faster do not change
                key=NOT_NEGATIVE,
                low_is_convention=True,
                plausible=lambda s: max(0.005, 4.0 * s.interval),
                physical="low",
            ),
        ),
        separations=(
            Separation(
                "speed_lag",
                "fast ramps",
                "a delay shifts current and speed, a lag of the sensor the speed alone",
            ),
        ),
    ),
    Effect(
        "clock_skew",
        "timing",
        "time stamps t (1 + relative), of the logger (all columns) or of the command column alone",
        (
            Parameter(
                "relative",
                "1",
                constant(0.01),
                constant(-0.05),
                constant(0.05),
                key=SKEW,
                physical="both",
                plausible=lambda s: s.clock,
            ),
        ),
        remark="within +-0.05. Without a position or a second clock a logger's skew has the same "
        "effect on the log as `added_inertia`",
        form=Form("clock", ("logger", "command"), "command_clock"),
        equations=("voltage", "torque", "command", "sensor_speed"),
        less_likely=True,
    ),
)
