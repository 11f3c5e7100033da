"""A bolt on a stack of disc springs (DIN EN 16984)."""

from ..entry import Load, LoadKey
from ..keys import between, whole
from .keys import FROM_TURNS, RUN_TORQUE, TWIST

LOAD = Load(
    "disc_spring",
    "force of the stack times the lever arms of thread and head, plus run_torque_nm",
    (
        *TWIST,
        RUN_TORQUE,
        LoadKey("parallel", "1", whole(1, 1000), 1.0),
        LoadKey("series", "1", whole(1, 1000), 1.0),
        LoadKey("friction", "1", between(0, 2), 0.12),
        FROM_TURNS,
        LoadKey("disc_outer_m", "m", between(1e-4, 10).optional(), 40e-3),
        LoadKey("disc_inner_m", "m", between(1e-5, 10).optional(), 20.4e-3),
        LoadKey("disc_thickness_m", "m", between(1e-5, 1).optional(), 1.5e-3),
        LoadKey("disc_cone_m", "m", between(1e-6, 1).optional(), 1.15e-3),
        LoadKey("bolt_pitch_m", "m", between(1e-5, 0.1).optional(), 2e-3),
        LoadKey("bolt_flank_m", "m", between(1e-4, 1).optional(), 14.701e-3),
        LoadKey("bolt_head_m", "m", between(1e-4, 1).optional(), 20e-3),
    ),
    joint=True,
)
