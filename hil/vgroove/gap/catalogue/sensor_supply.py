"""Effects of the bus voltage's sensor."""

from .common import relative
from .entry import Effect

EFFECTS = (
    Effect(
        "supply_gain",
        "sensor_supply",
        "measured bus (1 + relative)",
        (relative(0.02, 0.5, plausible=0.05),),
        needs=("supply",),
        less_likely=True,
    ),
)
