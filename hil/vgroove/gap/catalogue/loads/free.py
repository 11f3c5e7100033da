"""A friction at the output shaft, behind the gear (docs/spec/model.md, section 3)."""

from ..entry import Load
from .keys import FRICTION_FORM, FRICTION_LAW

LOAD = Load(
    "free", "friction law of docs/spec/model.md, section 3", FRICTION_LAW, form=FRICTION_FORM
)
