"""The menu of runs that a prototype can perform by itself, as commands over time that a simulation
or a board can follow, scaled to the tool's input.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vgroove.errors import VgrooveError

PROFILE_S, REST_S = 4.0, 0.2  # duration of a run, and of the rest that it begins with, s
MAX_ROWS = 4000  # rows of a simulated run: 1 kHz
MAX_INTERVAL_S = 1.0  # of its rows: so slow a logger still records four rows of a run
COUNT_TOLERANCE = 1e-6  # relative, of a number of rows: rounding of the interval


@dataclass(frozen=True)
class RunProfile:
    """A run: its command over time.

    level: shares of the largest command from each instant of time_s on; linear: joined by straight
    lines, else held. opens_bridge: the bridge opens where the level is 0, but for the rest at the
    beginning. load: points [time in s, share of the largest load]. content: what its log contains.
    """

    name: str
    content: str
    time_s: tuple[float, ...]
    level: tuple[float, ...]
    linear: bool = False
    opens_bridge: bool = False
    load: tuple[tuple[float, float], ...] = ()
    joint: str = ""
    channels: tuple[str, ...] = ()

    def command(self, time_s: np.ndarray) -> np.ndarray:
        """Shares (n,) of the largest command."""
        if self.linear:
            return np.interp(time_s, self.time_s, self.level)
        return np.asarray(self.level)[np.searchsorted(self.time_s, time_s, side="right") - 1]

    def bridge_open(self, time_s: np.ndarray) -> np.ndarray:
        """Whether (n,) the bridge is open."""
        after_rest = self.opens_bridge and time_s > self.time_s[1]
        return np.logical_and(after_rest, self.command(time_s) == 0.0)

    def points(self) -> list[list[float]]:
        """[time in s, share of the largest command] of each change."""
        return [[t, v] for t, v in zip(self.time_s, self.level, strict=True)]


def _steps(name: str, content: str, levels: list[float], **more: Any) -> RunProfile:
    """Levels of equal length after a rest."""
    each = (PROFILE_S - REST_S) / len(levels)
    starts = (0.0, *(REST_S + each * k for k in range(len(levels))))
    return RunProfile(name, content, starts, (0.0, *levels), **more)


MENU: tuple[RunProfile, ...] = (
    _steps(
        "staircase",
        "slow and fast steady speeds up to the full command",
        [0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0, 0.3],
    ),
    _steps(
        "reversal",
        "the same speeds in both directions",
        [0.3, -0.3, 0.6, -0.6, 1.0, -1.0, 0.15, -0.15],
    ),
    _steps(
        "coast-down",
        "free deceleration with the bridge open: friction and inertia without the electrical side",
        [0.6, 0.0, 1.0, 0.0],
        opens_bridge=True,
    ),
    _steps(
        "stall pulse",
        "large currents near standstill: resistance, current sensor and bus without back-EMF",
        [1.0, *[0.0] * 9, 1.0, *[0.0] * 9, 0.5, *[0.0] * 9, 0.5, *[0.0] * 9],
    ),
    RunProfile(
        "slow sweep",
        "low speeds passed slowly: breakaway",
        (0.0, REST_S, 2.2, PROFILE_S),
        (0.0, 0.0, 0.15, 0.0),
        True,
    ),
    _steps(
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
    _steps("hold at heat", "a long hold at the largest command", [1.0]),
    _steps("fast ramps", "steep command edges at several speeds", [0.3, 0.8] * 8 + [0.1, 1.0] * 4),
)

IMPACT_MENU: tuple[RunProfile, ...] = (
    _steps("tighten", "the same run again: the joint from its start at the full command", [1.0]),
    _steps(
        "three supplies",
        "impact cycles at three supplies, by duty: spring, friction and voltage act differently",
        [1.0, 0.8, 0.65],
    ),
    _steps(
        "locked joint",
        "impact cycles at three supplies on a joint that does not turn: mechanism without thread",
        [1.0, 0.8, 0.65],
        joint="locked",
    ),
    _steps(
        "free run",
        "motor and gear alone: the anvil turns freely and no blow occurs",
        [0.3, 0.65, 1.0],
        joint="none",
    ),
    _steps("loosening", "the joint tightened, then loosened", [1.0, -1.0]),
    *(
        _steps(f"tighten, with {what}", f"the same run with the {what}", [1.0], channels=(column,))
        for column, what in (
            ("hammer_mm", "displacement of the hammer"),
            ("anvil_angle_rad", "angle of the anvil"),
        )
    ),
)


def time_grid(interval_s: float) -> np.ndarray:
    """Row times in s of a run that is recorded every interval_s, MAX_INTERVAL_S at most."""
    row_s = min(max(interval_s, PROFILE_S / MAX_ROWS), MAX_INTERVAL_S)
    return row_s * np.arange(1, int(PROFILE_S / row_s * (1.0 + COUNT_TOLERANCE)) + 1)


def feasible_profiles(has_duty: bool, has_load: bool, both_ways: bool) -> list[RunProfile]:
    """The runs that a tool and its bench can perform: an open bridge needs a duty as input, load
    steps a brake, reversals a tool that turns both ways.
    """
    return [
        profile
        for profile in MENU
        if (has_duty or not profile.opens_bridge)
        and (has_load or not profile.load)
        and (both_ways or min(profile.level) >= 0.0)
    ]


def profile_named(name: str) -> RunProfile:
    """The run of that name, with spaces or underscores; VgrooveError that lists the menu."""
    for profile in (*MENU, *IMPACT_MENU):
        if profile.name == name.replace("_", " "):
            return profile
    names = "; ".join(profile.name for profile in (*MENU, *IMPACT_MENU))
    raise VgrooveError(f"there is no run {name}; the menu has {names}")


def profile_from_verdict(verdict: Mapping[str, Any], source: str) -> RunProfile:
    """The run that a verdict's JSON proposes, with its points (docs/spec/gap.md, section 5).

    source: the file's name, for messages. VgrooveError where the verdict proposes no run or its
    points are not those of a run.
    """
    asked = verdict.get("next_experiment")
    if not isinstance(asked, Mapping):
        raise VgrooveError(
            f"{source}: its verdict is {verdict.get('verdict')} and asks for no further run"
        )
    profile = profile_named(str(asked.get("profile")))
    time_s, level = _points(asked.get("points", profile.points()), source)
    if not _is_command(time_s, level):
        raise VgrooveError(
            f"{source}: points of next_experiment begin at 0 s, go on in time to {PROFILE_S:g} s"
            " at most, lie in -1..1, and are not all 0"
        )
    return replace(profile, time_s=tuple(time_s.tolist()), level=tuple(level.tolist()))


def _points(given: Any, source: str) -> tuple[np.ndarray, np.ndarray]:
    """Times in s and levels of the command (n,) from a run's points; VgrooveError unless these are
    a list of pairs of finite numbers.
    """
    try:
        points = np.asarray(given)
    except ValueError:  # lists of different lengths
        points = np.empty(0)
    numbers = points.dtype.kind in "iuf" and bool(np.isfinite(points).all())
    if not numbers or points.ndim != 2 or points.shape[1] != 2:
        raise VgrooveError(
            f"{source}: points of next_experiment are pairs [s, share of the largest command] of "
            "finite numbers"
        )
    time_s, level = points.astype(float).T
    return time_s, level


def _is_command(time_s: np.ndarray, level: np.ndarray) -> bool:
    """Whether points (n,) are a command: times that begin at 0 and increase up to PROFILE_S; levels
    in -1..1 that are not all 0.
    """
    return (
        len(time_s) >= 2
        and bool(np.any(level != 0.0))
        and time_s[0] == 0.0
        and not np.any(np.diff(time_s) <= 0.0)
        and not time_s[-1] > PROFILE_S
        and bool(np.all(np.abs(level) <= 1.0))
    )
