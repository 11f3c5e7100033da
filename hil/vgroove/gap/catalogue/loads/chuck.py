"""The drill driver's chuck: a friction for a time, and a torque that rises with the angle."""

from ..entry import Load, LoadKey
from ..keys import between
from .keys import FRICTION_FORM, FRICTION_LAW

LOAD = Load(
    "chuck",
    "friction law of section 3 from from_s to to_s, and a torque that rises with the angle",
    (
        *FRICTION_LAW,
        LoadKey("from_s", "s", between(0, 1e4), None),
        LoadKey("to_s", "s", between(0, 1e4), None),
        LoadKey("rise_nm_per_rad", "N m/rad", between(0, 1e8).optional(), None),
        LoadKey("rise_from_rad", "rad", between(-1e6, 1e6).optional(), None),
        LoadKey("rise_most_nm", "N m", between(0, 1e8).optional(), None),
    ),
    form=FRICTION_FORM,
)
