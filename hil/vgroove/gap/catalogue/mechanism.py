"""Effects of the impact mechanism."""

from .common import relative
from .entry import ZERO, Effect, Parameter, constant
from .keys import NOT_NEGATIVE

EFFECTS = (
    Effect(
        "groove_friction",
        "mechanism",
        "torque on q: coefficient abs(axial force) r / cos(atan(l / r)) against q'",
        (
            Parameter(
                "coefficient",
                "1",
                constant(0.02),
                ZERO,
                constant(0.5),
                (0.5,),
                key=NOT_NEGATIVE,
                plausible=constant(0.05),
            ),
        ),
        needs=("impact",),
    ),
    Effect("spring_rate", "mechanism", "k_s (1 + relative)", (relative(0.05),), needs=("impact",)),
    Effect(
        "spring_preload", "mechanism", "F0 (1 + relative)", (relative(0.05),), needs=("impact",)
    ),
    Effect(
        "impact_damping",
        "mechanism",
        "contact damping b (1 + relative)",
        (relative(0.2, high=9.0, plausible=1.0),),
        needs=("impact",),
    ),
    Effect(
        "lug_wear",
        "mechanism",
        "h - height_m",
        (
            Parameter(
                "height_m",
                "m",
                constant(1e-4),
                constant(-2e-3),
                constant(2e-3),
                plausible=constant(5e-4),
            ),
        ),
        needs=("impact",),
    ),
)
