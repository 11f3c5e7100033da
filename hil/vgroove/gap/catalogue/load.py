"""Effects of the joint."""

from .common import relative
from .entry import ZERO, Effect, Parameter, constant

SLIPPING = ("hard_joint", "disc_spring", "wood_screw")


def _end_of_knot(name: str, start: float) -> Parameter:
    """An end of a wood knot, in units of the angle by which the head turns in the log: beyond that
    angle it acts on nothing. Its differences are taken over about the angle of a blow.
    """
    return Parameter(
        name,
        "rad",
        lambda s: s.head_rad,
        ZERO,
        lambda s: 1.1 * s.head_rad,
        (start,),
        step=0.005,
        physical="both",
        local=True,
    )


EFFECTS = (
    Effect(
        "joint_stiffness",
        "load",
        "K (1 + relative)",
        (relative(0.1, high=9.0, plausible=0.3),),
        needs=("impact",),
        loads=("locked", *SLIPPING),
    ),
    Effect(
        "thread_friction",
        "load",
        "slip torque (1 + relative); disc springs: its friction part",
        (relative(0.1, high=9.0, plausible=0.3),),
        needs=("impact",),
        loads=SLIPPING,
    ),
    Effect(
        "joint_hysteresis",
        "load",
        "disc springs: spring force (1 - relative) while loosening",
        (
            Parameter(
                "relative",
                "1",
                constant(0.1),
                constant(0.0),
                constant(0.9),
                plausible=constant(0.2),
            ),
        ),
        needs=("impact",),
        loads=("disc_spring",),
    ),
    Effect(
        "wood_knot",
        "load",
        "slip torque + torque_nm between the head angles from_rad and to_rad",
        (
            Parameter("torque_nm", "N m", constant(1.0), constant(0.0), constant(100.0)),
            Parameter("from_rad", "rad", constant(1.0)),
            Parameter("to_rad", "rad", constant(1.0)),
        ),
        needs=("impact",),
        loads=SLIPPING,
        hammering=(
            Parameter(
                "torque_nm",
                "N m",
                lambda s: 0.2 * s.joint_nm,
                constant(0.0),
                constant(100.0),
                (1.0,),
            ),
            _end_of_knot("from_rad", 0.0),
            _end_of_knot("to_rad", 1.0),
        ),
    ),
)
