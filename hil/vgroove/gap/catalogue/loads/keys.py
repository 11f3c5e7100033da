"""Keys that several loads share. Ranges are wide: they only exclude values in a wrong
unit.
"""

from ..entry import Form, LoadKey
from ..keys import between

TWIST = (
    LoadKey("stiffness_nm_per_rad", "N m/rad", between(1e-3, 1e9), 3000.0),
    LoadKey("damping_nm_s_per_rad", "N m s/rad", between(0, 1e6), 0.3),
)
RUN_TORQUE = LoadKey("run_torque_nm", "N m", between(0, 1e5))
FROM_TURNS = LoadKey("from_turns", "1", between(0, 1e4))
LOOSEN_RATIO = LoadKey("loosen_ratio", "1", between(0, 10), 0.75)

# docs/spec/model.md, section 3
FRICTION_LAW = (
    LoadKey("torque_nm", "N m", between(0, 1e5)),
    LoadKey("breakaway_ratio", "1", between(1, 10).optional(), 1.2),
    LoadKey("breakaway_rad_s", "rad/s", between(1e-6, 1e4).optional(), 0.1),
    LoadKey("viscous_nm_s_per_rad", "N m s/rad", between(0, 1e5).optional()),
    LoadKey("threshold_rad_s", "rad/s", between(1e-9, 1e4).optional(), 0.01),
    LoadKey("decay_s_per_rad", "s/rad", between(0, 1e6).optional(), 10.0),
)
FRICTION_FORM = Form("form", ("stribeck", "exponential"), "exponential")
