"""A joint that twists elastically and never turns."""

from ..entry import Load
from .keys import TWIST

LOAD = Load("locked", "elastic twist without a slip torque", TWIST, joint=True)
