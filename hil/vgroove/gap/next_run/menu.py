"""The runs that a prototype can do by itself, as commands a simulation or a board can follow,
scaled to a tool's input.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vgroove.errors import VgrooveError

PROFILE_S, REST_S = 4.0, 0.2
MAX_ROWS = 4000


@dataclass(frozen=True)
class RunProfile:
    """Command over time: held (or, `straight`, joined) levels from instants on as shares of the
    largest command; load as a share of the largest; coasts: the bridge opens where the level is 0
    after the first press.
    """

    name: str
    shows: str
    time_s: tuple[float, ...]
    level: tuple[float, ...]
    straight: bool = False
    coasts: bool = False
    load: tuple[tuple[float, float], ...] = ()

    def command(self, time_s: np.ndarray) -> np.ndarray:
        """Shares (n,) of the largest command."""
        if self.straight:
            return np.interp(time_s, self.time_s, self.level)
        return np.asarray(self.level)[np.searchsorted(self.time_s, time_s, side="right") - 1]

    def opens(self, time_s: np.ndarray) -> np.ndarray:
        """Where (n,) the bridge is open."""
        return np.logical_and(self.coasts and time_s > self.time_s[1], self.command(time_s) == 0.0)

    def points(self) -> list[list[float]]:
        """[time, share of the largest command] of each change."""
        return [[t, v] for t, v in zip(self.time_s, self.level, strict=True)]


def _held(name: str, shows: str, levels: list[float], **more: object) -> RunProfile:
    """Levels of equal length after a rest."""
    each = (PROFILE_S - REST_S) / len(levels)
    return RunProfile(
        name, shows, (0.0, *(REST_S + each * k for k in range(len(levels)))), (0.0, *levels), **more
    )


MENU: tuple[RunProfile, ...] = (
    _held(
        "staircase",
        "slow and fast steady speeds up to the full command",
        [0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0, 0.3],
    ),
    _held(
        "reversal",
        "the same speeds in both directions",
        [0.3, -0.3, 0.6, -0.6, 1.0, -1.0, 0.15, -0.15],
    ),
    _held(
        "coast-down",
        "free deceleration with the bridge open: friction and inertia without the electrical side",
        [0.6, 0.0, 1.0, 0.0],
        coasts=True,
    ),
    _held(
        "stall pulse",
        "large currents near standstill: resistance, current sensor and bus without back-EMF",
        [1.0, *[0.0] * 9, 1.0, *[0.0] * 9, 0.5, *[0.0] * 9, 0.5, *[0.0] * 9],
    ),
    RunProfile(
        "slow sweep",
        "a slow passage through low speeds: break-away",
        (0.0, REST_S, 2.2, PROFILE_S),
        (0.0, 0.0, 0.15, 0.0),
        True,
    ),
    _held(
        "load steps",
        "current changed at constant speed",
        [0.8],
        load=(
            (0.0, 0.0),
            (0.8, 0.0),
            (0.85, 0.5),
            (1.8, 0.5),
            (1.85, 1.0),
            (2.8, 1.0),
            (2.85, 0.2),
            (3.5, 0.0),
        ),
    ),
    _held("hold at heat", "a long hold at the largest command", [1.0]),
    _held("fast ramps", "steep command edges at several speeds", [0.3, 0.8] * 8 + [0.1, 1.0] * 4),
)


def time_grid(interval_s: float) -> np.ndarray:
    """Row times of a run."""
    return np.arange(1, min(MAX_ROWS, round(PROFILE_S / interval_s)) + 1) * max(
        interval_s, PROFILE_S / MAX_ROWS
    )


def feasible_profiles(has_duty: bool, has_load: bool, both_ways: bool) -> list[RunProfile]:
    """The runs that a tool and its bench can do: coasting needs a bridge, load steps a brake,
    reversals a tool that turns back.
    """

    def can(course: RunProfile) -> bool:
        return (
            (has_duty or not course.coasts)
            and (has_load or not course.load)
            and (both_ways or min(course.level) >= 0.0)
        )

    return [course for course in MENU if can(course)]


def profile_named(name: str) -> RunProfile:
    """The run of that name; VgrooveError with those that there are."""
    for course in MENU:
        if course.name == name.replace("_", " "):
            return course
    raise VgrooveError(
        f"there is no run {name}; the menu has {', '.join(course.name for course in MENU)}"
    )


def profile_from_verdict(verdict: Mapping[str, Any], source: str) -> RunProfile:
    """The run that a verdict (gap contract, section 5) asks for, at its points; VgrooveError where
    it asks for none or they are no run.
    """
    asked = verdict.get("next_experiment")
    if not isinstance(asked, Mapping):
        raise VgrooveError(
            f"{source}: its verdict is {verdict.get('verdict')} and asks for no further run"
        )
    course = profile_named(str(asked.get("profile")))
    try:
        time_s, level = np.array(asked.get("points", course.points()), float).reshape(-1, 2).T
    except (TypeError, ValueError):
        raise VgrooveError(
            f"{source}: points of next_experiment are pairs [s, share of the largest command]"
        ) from None
    if (
        len(time_s) < 2
        or time_s[0] != 0.0
        or np.any(np.diff(time_s) <= 0.0)
        or time_s[-1] > PROFILE_S
        or not np.all(np.abs(level) <= 1.0)
    ):
        raise VgrooveError(
            f"{source}: points of next_experiment begin at 0 s, go on in time to {PROFILE_S:g} s at most, "
            "and lie in -1..1"
        )
    return replace(course, time_s=tuple(time_s.tolist()), level=tuple(level.tolist()))
