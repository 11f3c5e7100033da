"""Effects of the motor's winding, brushes and magnets."""

from .common import relative, time_constant
from .entry import OFF_AT_INFINITY, ZERO, Effect, Parameter, Separation, constant
from .keys import POSITIVE

# Limits in practice: the winding of the smallest motors is 0.1 g of copper (0.39 J/(g K)), and its
# thermal time constant about 1 s
MOST_KELVIN_PER_JOULE = 25.0
SHORTEST_COOLING_S = 0.5

EFFECTS = (
    Effect(
        "winding_resistance",
        "motor_electrical",
        "R (1 + relative)",
        (relative(0.05, high=3.0, plausible=0.3),),
        needs=("voltage",),
        identical_to=(("bridge_resistance", ()),),
    ),
    Effect(
        "winding_heating",
        "motor_electrical",
        # 0.0039 1/K: copper; D: temperature of the winding above its cold state, K
        "R (1 + 0.0039 D); D' = kelvin_per_joule i^2 R (1 + 0.0039 D) - D / cooling_s",
        (
            Parameter(
                "kelvin_per_joule",
                "K/J",
                lambda s: 20.0 / (s.amp**2 * s.resistance * s.duration),
                ZERO,
                constant(MOST_KELVIN_PER_JOULE),
                starts=(0.3,),
                widest_high=constant(MOST_KELVIN_PER_JOULE),
                plausible=lambda s: 100.0 / (s.amp**2 * s.resistance * s.duration),
            ),
            time_constant(
                "cooling_s",
                (0.3, 2.0, 10.0),
                neutral=OFF_AT_INFINITY,
                shortest_s=SHORTEST_COOLING_S,
            ),
        ),
        needs=("voltage",),
        switch=("kelvin_per_joule",),
    ),
    Effect(
        "brush_drop",
        "motor_electrical",
        "v - voltage_v tanh(i / 0.3 A), averaged over the PWM ripple as for dead_time",
        (
            Parameter(
                "voltage_v",
                "V",
                lambda s: 0.02 * s.volt,
                ZERO,
                lambda s: 0.5 * s.volt,
                plausible=constant(1.0),
            ),
        ),
        needs=("voltage",),
        switch=("voltage_v",),
    ),
    Effect(
        "inductance",
        "motor_electrical",
        "L (1 + relative)",
        # an inductance is often assumed, and differs with the frequency at which it is measured
        (relative(0.2, high=9.0, plausible=1.0),),
        needs=("voltage",),
        equations=("voltage", "command"),
        less_likely=True,
    ),
    Effect(
        "torque_constant",
        "motor_electrical",
        "k (1 + relative), in torque and back-EMF",
        (relative(0.02, 0.5),),
        identical_to=(("current_gain", ("current_input",)),),
        equations=("voltage", "torque"),
        separations=(
            Separation(
                "speed_gain",
                "stall pulse",
                "at standstill the speed sensor has no influence, the torque constant has",
            ),
        ),
    ),
    Effect(
        "magnetic_saturation",
        "motor_electrical",
        "k / (1 + (i / saturation_a)^2), in torque and back-EMF",
        (
            Parameter(
                "saturation_a",
                "A",
                lambda s: s.amp,
                lambda s: 0.5 * s.amp,
                lambda s: 40.0 * s.amp,
                (5.0,),
                key=POSITIVE,
                neutral=OFF_AT_INFINITY,
                # a tenth of the torque constant is lost at the largest current
                plausible=lambda s: 3.0 * s.amp,
            ),
        ),
        switch=("saturation_a",),
        equations=("voltage", "torque"),
        less_likely=True,
    ),
)
