"""The drill driver's chuck: a friction between two instants, and a torque that rises with angle."""

from ..entry import Load, LoadKey
from ..keys import between
from .keys import FRICTION_FORM, FRICTION_LAW

LOAD = Load(
    "chuck",
    "friction law of docs/spec/model.md, section 3, between the times from_s and to_s, and a "
    "torque that rises with the angle",
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
