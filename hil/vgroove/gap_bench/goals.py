"""Goals of the project for the blind set: share of right verdicts by regime and kind of case."""

GOALS = {
    "exact": {"single": 0.98, "pair": 0.92},
    "hard": {"single": 0.93, "pair": 0.80, "triple": 0.60},
    "measured": {},
}
# of the hammering tool
IMPACT_GOALS = {
    "exact": {"single": 0.85, "pair": 0.85, "none": 0.98, "unlisted": 0.80},
    "loose": {"single": 0.75, "pair": 0.75, "none": 0.98, "unlisted": 0.80},
}
