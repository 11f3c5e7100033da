"""A friction behind the gear."""

from ..entry import Load
from .keys import FRICTION_FORM, FRICTION_LAW

LOAD = Load("free", "friction law of section 3", FRICTION_LAW, form=FRICTION_FORM)
