"""Effects of the supply."""

from .common import LONGEST, series_resistance, time_constant
from .entry import ZERO, Effect, Parameter

# A battery cannot lose more than its voltage: by the slowest polarisation that is looked for, of
# LONGEST durations of the log, or by a mean current of as small a share of the largest one
MOST_LOSS = LONGEST

EFFECTS = (
    Effect(
        "supply_resistance",
        "supply",
        "Vs = Voc - (Rs + resistance_ohm) d i",
        (series_resistance(lambda s: -s.supply_ohm),),
        needs=("voltage",),
        special_case_of=("supply_droop",),
    ),
    Effect(
        "supply_droop",
        "supply",
        "Voc falls by volt_per_coulomb * q + vp; q' = d i; "
        "vp' = (polarisation_ohm d i - vp) / polarisation_s",
        (
            Parameter(
                "volt_per_coulomb",
                "V/C",
                lambda s: 0.02 * s.volt / (s.amp * s.duration),
                ZERO,
                lambda s: MOST_LOSS * s.volt / (s.amp * s.duration),
                physical="high",
                plausible=lambda s: 0.2 * s.volt / (s.amp * s.duration),
            ),
            Parameter(
                "polarisation_ohm",
                "ohm",
                lambda s: 0.02 * s.volt / s.amp,
                ZERO,
                lambda s: MOST_LOSS * s.volt / s.amp,
                starts=(0.5,),
                physical="high",
                plausible=lambda s: 0.1 * s.volt / s.amp,
            ),
            time_constant("polarisation_s", (0.1, 0.6)),
        ),
        needs=("voltage",),
        switch=("volt_per_coulomb", "polarisation_ohm"),
    ),
)
