"""A bolted hard joint: the slip torque rises with the head angle."""

from ..entry import Load, LoadKey
from ..keys import between
from .keys import LOOSEN_RATIO, RUN_TORQUE, TWIST

LOAD = Load(
    "hard_joint",
    "slip torque run_torque_nm + slip_slope_nm_per_rad * head angle, its second part times "
    "loosen_ratio backwards",
    (
        *TWIST,
        RUN_TORQUE,
        LoadKey("slip_slope_nm_per_rad", "N m/rad", between(0, 1e8)),
        LOOSEN_RATIO,
    ),
    joint=True,
)
