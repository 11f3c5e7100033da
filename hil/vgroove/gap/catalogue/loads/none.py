"""No load: the output shaft is free; the anvil of an impact mechanism turns freely."""

from ..entry import Load

LOAD = Load("none", "no torque", diagnosed=True)
