"""Effects of the bridge."""

from .entry import ZERO, Effect, Form, Parameter, Separation

EFFECTS = (
    Effect(
        "dead_time",
        "bridge",
        "v = d Vs - 2 dead_time_s pwm_hz Vs S(i) for 0 < abs(d) < 1; S(i) is sign(i) averaged "
        "over the PWM ripple: i / ir within +-1, "
        "ir = max(0.2 A, abs(d) (1 - abs(d)) Vs / (2 L pwm_hz))",
        (
            Parameter(
                "dead_time_s",
                "s",
                lambda s: 0.01 / s.pwm_hz,
                ZERO,
                lambda s: 0.2 / s.pwm_hz,
                plausible=lambda s: 0.05 / s.pwm_hz,
            ),
        ),
        needs=("duty",),
        # "edges": S(i) from the current at the two edges of the pulse, as a bridge switches
        form=Form("form", ("mean", "edges"), "at_edges", beyond_specification=("edges",)),
        switch=("dead_time_s",),
        less_likely=True,
        separations=(
            Separation(
                "brush_drop",
                "staircase up to full duty",
                "at full duty nothing switches, so that dead time takes no voltage; the brush "
                "drop remains",
            ),
        ),
    ),
    Effect(
        "bridge_resistance",
        "bridge",
        "v = d Vs - resistance_ohm i",
        (
            Parameter(
                "resistance_ohm",
                "ohm",
                lambda s: 0.05 * s.resistance,
                lambda s: -0.9 * s.resistance * s.least_share("motor.resistance_ohm"),
                lambda s: 3.0 * s.resistance,
                physical="low",
                plausible=lambda s: 0.3 * s.resistance,
            ),
        ),
        needs=("duty",),
    ),
)
