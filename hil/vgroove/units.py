"""Factors between SI units, in which all computations run, and the units of logs and pages."""

import math

TURN_RAD = 2.0 * math.pi
MINUTE_S = 60.0
RPM_PER_RAD_S = 30.0 / math.pi
RAD_S_PER_RPM = math.pi / 30.0
BYTES_PER_KIB = 1 << 10
BYTES_PER_MIB = 1 << 20
# factor of times in a unit over those in s, and its name
TIME_UNITS = {1e3: "ms", 1e6: "us", 1e9: "ns", 1 / 60: "min", 1 / 3600: "h", 1 / 86_400: "d"}
