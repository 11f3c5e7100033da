"""Effects of the gear and of the coupling behind it."""

from collections.abc import Mapping
from math import inf, pi, sqrt

from .common import PHASE, torque
from .entry import (
    OFF_AT_INFINITY,
    OUTPUT_TURN,
    ZERO,
    Effect,
    Parameter,
    Periodic,
    Scales,
    Separation,
    constant,
)
from .keys import NOT_NEGATIVE, POSITIVE

# Natural frequency, rad/s, of steel teeth in contact against the inertia of both sides: an estimate
# that holds within a factor of three.
TOOTH_CONTACT_RAD_S = 4000.0


def _tooth_stiffness(s: Scales) -> float:
    """Stiffness, N m/rad, at which the reduced inertia of both sides oscillates with
    TOOTH_CONTACT_RAD_S; an output side of at least 1 % of the inertia is assumed.
    """
    return TOOTH_CONTACT_RAD_S**2 * s.motor_inertia * max(1.0 - s.motor_inertia / s.inertia, 0.01)


# Tooth flanks in contact, at both ends of a play; a rig states them as the keys of the effect
# coupler_compliance. No data sheet states their coefficient of restitution (the starts of the
# damping ratio correspond to 0.8, 0.7 and 0.6), and a few per cent of it change where in the play
# the output side is at the next reversal: they are fitted as nuisance parameters.
FLANKS = (
    Parameter(
        "stiffness_nm_per_rad",
        "N m/rad",
        _tooth_stiffness,
        lambda s: 0.1 * _tooth_stiffness(s),
        lambda s: 10.0 * _tooth_stiffness(s),
        (0.5,),
        reported=False,
        key_of="coupler_compliance",
    ),
    Parameter(
        "damping_ratio",
        "1",
        lambda s: 0.1 * (s.motor_inertia / s.inertia) ** 0.5,
        constant(0.002),
        constant(1.0),
        (0.7, 1.1, 1.7),
        step=0.02,
        reported=False,
        key_of="coupler_compliance",
    ),
)

# A torque sensor between anvil and joint (docs/spec/model.md, section 6): 2,000 N m/rad, 0.2 N m
# s/rad, 2e-5 kg m2. Stiffer than 1e5 N m/rad it is rigid beside any joint.
COUPLER_BEFORE_JOINT = (
    Parameter(
        "stiffness_nm_per_rad",
        "N m/rad",
        constant(2000.0),
        constant(50.0),
        constant(1e5),
        (0.3, 1.0, 3.0),
        key=POSITIVE,
        neutral=OFF_AT_INFINITY,
        widest_high=constant(1e5),
        plausible=constant(2000.0),
    ),
    Parameter(
        "damping_ratio",
        "1",
        constant(0.05),
        constant(0.002),
        constant(2.0),
        (8.0,),
        key=NOT_NEGATIVE,
        widest_low=constant(0.002),
    ),
    Parameter(
        "inertia_kg_m2",
        "kg m2",
        constant(2e-5),
        ZERO,
        constant(1e-3),
        (1.0,),
        key=NOT_NEGATIVE,
    ),
)

# Natural frequencies, rad/s, between which a coupler is looked for
COUPLER_RAD_S = 10.0, 3000.0


def _coupler_stiffness(s: Scales, rad_s: float) -> float:
    """Stiffness, N m/rad, of a spring on which the inertia of the whole shaft has the natural
    frequency rad_s.
    """
    return s.inertia * rad_s**2


def _softest_coupler(s: Scales) -> float:
    """Lower bound of the stiffness, N m/rad."""
    return _coupler_stiffness(s, COUPLER_RAD_S[0])


def _stiffest_coupler(s: Scales) -> float:
    """Upper bound of the stiffness, N m/rad: at a higher one more than one period of the
    oscillation passes between two rows, and the log does not show it.
    """
    return _coupler_stiffness(s, min(COUPLER_RAD_S[1], 2.0 * pi / s.interval))


def _resolves_coupler(values: Mapping[str, float], s: Scales) -> bool:
    """Whether at most one period of the oscillation of rotor and output side on the coupler passes
    between two rows.
    """
    output = s.inertia - s.motor_inertia + values["inertia_kg_m2"]
    compliance = (1.0 / s.motor_inertia + 1.0 / output) if output > 0.0 else inf
    return sqrt(values["stiffness_nm_per_rad"] * compliance) <= 2.0 * pi / s.interval


EFFECTS = (
    Effect(
        "load_dependent_friction",
        "gearbox",
        "T + relative abs(TL) / N sign(w); with an impact mechanism TL / N is k i",
        (
            Parameter(
                "relative",
                "1",
                constant(0.05),
                ZERO,
                constant(2.0),
                plausible=constant(0.2),
            ),
        ),
        needs=("load",),
        switch=("relative",),
    ),
    Effect(
        "gear_eccentricity",
        "gearbox",
        "T + torque_nm sin(th / N + phase_rad)",
        (torque(), PHASE),
        needs=("rows",),
        periodic=Periodic("torque_nm", OUTPUT_TURN),
        special_case_of=("cogging_torque",),
        switch=("torque_nm",),
    ),
    Effect(
        "coupler_compliance",
        "gearbox",
        "mechanism `none`, at the motor shaft: the output side J2 = J_out / N^2 + inertia_kg_m2 "
        "(J_out with m l^2 of a pendulum) moves behind a spring with damping "
        "c = 2 damping_ratio sqrt(stiffness_nm_per_rad J2); "
        "mechanism `impact`: the spring is between anvil and joint, J2 = inertia_kg_m2",
        (
            Parameter(
                "stiffness_nm_per_rad",
                "N m/rad",
                lambda s: _coupler_stiffness(s, 100.0),
                _softest_coupler,
                _stiffest_coupler,
                # natural frequencies of 14 to 340 rad/s: the response is not linear in it
                tuple(0.02 * 1.4**n for n in range(20)),
                key=POSITIVE,
                neutral=OFF_AT_INFINITY,
                widest_low=_softest_coupler,
                plausible=lambda s: _coupler_stiffness(s, 50.0),
            ),
            Parameter(
                "damping_ratio",
                "1",
                constant(0.05),
                constant(0.002),
                constant(1.0),
                (1.0,),
                key=NOT_NEGATIVE,
            ),
            Parameter(
                "inertia_kg_m2",
                "kg m2",
                lambda s: 0.1 * s.inertia,
                ZERO,
                lambda s: 20.0 * s.inertia,
                (0.02, 1.0),
                key=NOT_NEGATIVE,
            ),
        ),
        less_likely=True,
        hammering=COUPLER_BEFORE_JOINT,
        is_resolved=_resolves_coupler,
        separations=(
            Separation(
                "added_inertia",
                "fast ramps",
                "a spring oscillates after steep edges, a rigid inertia does not",
            ),
        ),
    ),
    Effect(
        "gear_backlash",
        "gearbox",
        "the output side follows the motor only after a play of play_rad (total, at the output)",
        (
            Parameter(
                "play_rad",
                "rad",
                constant(0.02),
                ZERO,
                constant(1.0),
                tuple(0.25 * 1.25**n for n in range(23)),  # 5 mrad to 0.7 rad
                key=NOT_NEGATIVE,
                plausible=constant(0.1),
            ),
            *FLANKS,
        ),
        needs=("output",),
    ),
)
