"""A point mass on an arm at the output shaft."""

from ..entry import Load, LoadKey
from ..keys import between

LOAD = Load(
    "pendulum",
    "mass_kg g length_m sin(angle - zero_rad); mass_kg length_m^2 adds to the output inertia",
    (
        LoadKey("mass_kg", "kg", between(1e-6, 1e5)),
        LoadKey("length_m", "m", between(1e-5, 1e2)),
        LoadKey("zero_rad", "rad", between(-1e6, 1e6).optional()),
    ),
    diagnosed=True,
)
