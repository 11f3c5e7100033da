"""A lag screw in softwood: driving torque over the depth, seat, stripped thread."""

from ..entry import Load, LoadKey
from ..keys import between
from .keys import FROM_TURNS, LOOSEN_RATIO, TWIST

LOAD = Load(
    "wood_screw",
    "slip torque start_nm .. end_nm over turns, up to seat_nm within seat_deg, then down to "
    "stripped_ratio of it; times loosen_ratio backwards",
    (
        *TWIST,
        LoadKey("start_nm", "N m", between(0, 1e5)),
        LoadKey("end_nm", "N m", between(1e-6, 1e5)),
        LoadKey("turns", "1", between(1e-2, 1e4), 1.0),
        LoadKey("seat_nm", "N m", between(1e-6, 1e5)),
        LoadKey("seat_deg", "deg", between(1e-2, 1e5), 90.0),
        LoadKey("stripped_ratio", "1", between(0, 10), 0.35),
        FROM_TURNS,
        LOOSEN_RATIO,
    ),
    joint=True,
)
