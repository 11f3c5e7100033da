"""Commands of the impact cases: trigger steps, ramps, levels, release and loosening."""

import numpy as np
from profiles import Profile

NAMES = ("plain", "ramp", "levels", "release", "loosen")
LEAST_DUTY = 0.6  # of a level: below it a lug is hit several times
BREAK_S = 0.25  # between tightening and loosening


def draw_impact(name: str, seconds: float, tightened: bool, rng: np.random.Generator) -> Profile:
    """A profile by its name, `seconds` long, at rest at first. Loosening starts at once where the
    joint is tight (`tightened`), else after tightening for half of the time.
    """
    begin = round(float(rng.uniform(0.03, 0.08)), 3)
    level = float(rng.choice([1.0, 1.0, rng.uniform(0.75, 1.0)]))
    if name == "ramp":
        rise = float(rng.uniform(0.2, 0.8))
        times = np.array([0.0, begin, begin + rise, seconds + 0.1])
        return Profile(name, times, np.array([0.0, 0.0, level, level]), smooth=True)
    times, levels = [begin], [level]
    if name == "levels":
        count = max(2, int((seconds - begin) / 0.7))
        times = list(begin + (seconds - begin) / count * np.arange(count))
        levels = list(
            rng.permutation(np.linspace(float(rng.uniform(LEAST_DUTY, 0.75)), 1.0, count))
        )
    if name == "release":
        times, levels = [begin, seconds - 0.35], [level, 0.0]
    if name == "loosen" and tightened:
        levels = [-level]
    elif name == "loosen":
        middle = 0.5 * seconds
        times, levels = [begin, middle, middle + BREAK_S], [level, 0.0, -level]
    return Profile(
        name,
        np.array([0.0, *times]),
        np.array([0.0, *levels]),
        coast_at_zero=name in ("release", "loosen"),
    )


def holds(profile: Profile, seconds: float) -> list[tuple[float, float]]:
    """(begin, end) of the parts of a profile with a constant duty other than zero."""
    times = np.append(profile.time_s, seconds)
    out = []
    for n, duty in enumerate(profile.duty):
        begin, end = times[n], min(times[n + 1], seconds)
        ends = profile.duty[min(n + 1, len(profile.duty) - 1)]
        steady = duty != 0.0 and (not profile.smooth or ends == duty)
        if steady and end - begin > 0.2:
            out.append((float(begin), float(end)))
    return out
