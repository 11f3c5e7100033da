"""A torque that the test bench measures: the column load_nm."""

from ..entry import Load

LOAD = Load(
    "torque", "the column load_nm opposes motion and holds the shaft at rest", diagnosed=True
)
