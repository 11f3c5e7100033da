"""Effects of the motor's friction, inertia and cogging. T is friction torque at the motor shaft,
positive against w > 0.
"""

from .common import PHASE, friction, torque, viscous
from .entry import MIN_PERIODS, ZERO, Effect, Parameter, Periodic, Separation, constant
from .keys import POSITIVE

LEAST_TURNS = 1e-4  # keeps a number of periods finite
MIN_WARM_UP_S = 0.1  # no drive warms its grease up in less

EFFECTS = (
    Effect(
        "coulomb_friction",
        "motor_mechanical",
        "T + torque_nm sign(w)",
        (friction(low=lambda s: -s.coulomb * s.least_share("motor.coulomb_nm")),),
        special_case_of=("asymmetric_friction", "stribeck_friction"),
        friction_law=True,
    ),
    Effect(
        "viscous_friction",
        "motor_mechanical",
        "T + nm_s_per_rad w",
        (viscous(lambda s: -s.viscous * s.least_share("motor.viscous_nm_s_per_rad")),),
        special_case_of=("cold_grease",),
        friction_law=True,
    ),
    Effect(
        "stribeck_friction",
        "motor_mechanical",
        "T + breakaway_nm exp(-(w / speed_rad_s)^2) sign(w)",
        (
            friction("breakaway_nm", ZERO, (0.3,)),
            Parameter(
                "speed_rad_s",
                "rad/s",
                lambda s: 0.1 * s.speed,
                lambda s: 0.003 * s.speed,
                lambda s: 0.6 * s.speed,
                (0.2, 0.8, 2.5),
                key=POSITIVE,
                neutral=1.0,
            ),
        ),
        switch=("breakaway_nm",),
        friction_law=True,
    ),
    Effect(
        "quadratic_drag",
        "motor_mechanical",
        "T + nm_s2_per_rad2 w abs(w)",
        (
            Parameter(
                "nm_s2_per_rad2",
                "N m s2/rad2",
                lambda s: 0.03 * s.torque / s.speed**2,
                ZERO,
                plausible=lambda s: 0.1 * s.torque / s.speed**2,
            ),
        ),
        switch=("nm_s2_per_rad2",),
        friction_law=True,
    ),
    Effect(
        "asymmetric_friction",
        "motor_mechanical",
        "T + forward_nm for w > 0, T - backward_nm for w < 0, any value in between at rest",
        (friction("forward_nm"), friction("backward_nm")),
        needs=("both",),
        constant_beside="coulomb_friction",
        remark="forward_nm = -backward_nm is a constant torque offset. Needs both directions: in a "
        "log of one direction it equals `coulomb_friction`",
    ),
    Effect(
        "directional_viscous",
        "motor_mechanical",
        "T + nm_s_per_rad abs(w)",
        (viscous(),),
        needs=("both",),
        remark="more viscous friction in one direction than in the other. Needs both directions: "
        "in a log of one direction it equals `viscous_friction`",
        switch=("nm_s_per_rad",),
    ),
    Effect(
        "cold_grease",
        "motor_mechanical",
        "T + nm_s_per_rad exp(-t / time_s) w",
        (
            viscous(ZERO, (0.3,)),
            Parameter(
                "time_s",
                "s",
                lambda s: s.duration,
                lambda s: max(0.03 * s.duration, MIN_WARM_UP_S),
                lambda s: 3.0 * max(s.duration, MIN_WARM_UP_S),
                (0.15, 0.6),
                key=POSITIVE,
                neutral=1.0,
                widest_low=constant(MIN_WARM_UP_S),
            ),
        ),
        switch=("nm_s_per_rad",),
    ),
    Effect(
        "added_inertia",
        "motor_mechanical",
        "J + kg_m2, at the motor shaft (negative allowed)",
        (
            Parameter(
                "kg_m2",
                "kg m2",
                lambda s: 0.05 * s.inertia,
                lambda s: -0.9 * s.motor_inertia * s.least_share("motor.inertia_kg_m2"),
                lambda s: 20.0 * s.inertia,
                physical="low",
                plausible=lambda s: 0.5 * s.inertia,
            ),
        ),
        special_case_of=("coupler_compliance",),
        separations=(
            Separation(
                "clock_skew",
                "coast-down",
                "with the bridge open an inertia stretches the run-down; a clock error also shifts "
                "the edges of a steady speed against the time stamps: hold a steady speed for "
                "some seconds before",
            ),
        ),
    ),
    Effect(
        "cogging_torque",
        "motor_mechanical",
        "T + torque_nm sin(periods_per_rev th + phase_rad)",
        (
            torque(),
            Parameter(
                "periods_per_rev",
                "1",
                constant(1.0),
                lambda s: max(0.2, MIN_PERIODS / max(s.turns, LEAST_TURNS)),
                lambda s: min(1e5, s.periods),
                (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0),
                step=0.002,
                key=POSITIVE,
                neutral=1.0,
                low_is_convention=True,
                physical="both",
            ),
            PHASE,
        ),
        periodic=Periodic("torque_nm", "periods_per_rev"),
        switch=("torque_nm",),
    ),
)
