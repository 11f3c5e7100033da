"""Search for the one EEPROM parameter with which the firmware gives all rows of a log."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vgroove import _replay, telemetry
from vgroove.firmware_replay.assumed_firmware import AssumedFirmware
from vgroove.firmware_replay.rows import COMPARE, STATE

# Factors of the assumed value; the first ones decide whether a parameter acts on the rows at all.
SCREEN = (0.5, 0.8, 1.25, 2.0)
FACTORS = (0.3, 0.4, 0.65, 0.9, 0.95, 1.05, 1.1, 1.55, 2.6, 3.5)
ZERO_STEPS = 12  # values of a parameter whose assumed value is 0, over its range
REFINED = 8  # parameters that are searched further
INNER = 3  # values between two others
# Parameters of which a log shows nothing, or that change the meaning of its columns
NOT_SEARCHED = ("mode", "baud", "fast_divider", "hall", "current_", "bus_gain", "dead_time")


# (most states, spread of the trigger) of the attempts: all rows agree where they do in one of them
QUICK = (512, 1)
ATTEMPTS = (QUICK, (2048, 4), (8192, 8))


@dataclass(frozen=True)
class Parting:
    """Where a replay parts from the log: the number of rows that agree (all: nowhere), the signal,
    the value of the firmware there that is nearest to the log's, and whether no state was left out.
    """

    row: int
    signal: str
    expected: int
    complete: bool = True


def replay(
    assumed: AssumedFirmware, rows: np.ndarray, attempts: tuple[tuple[int, int], ...] = ATTEMPTS
) -> Parting:
    """Replay an assumed firmware on rows (vgroove.firmware_replay.rows) with the limits of each
    attempt; of the replays the one that reproduces most rows.
    """
    image, pulses, best = assumed.image(), assumed.raw("hall_pulses"), None
    for most, spread in attempts:
        found = Parting(*_replay.replay(image, rows, most, spread, pulses))
        if best is None or found.row > best.row:
            best = found
        if found.row >= len(rows):
            break
    return best


@dataclass(frozen=True)
class FoundParameter:
    """A parameter with which all rows agree: stored value, and those from low to high as well."""

    name: str
    raw: int
    low: int
    high: int


class ParameterSearch:
    """Replays with one changed parameter; `rows` (n, 6)."""

    def __init__(self, assumed: AssumedFirmware, rows: np.ndarray, base: Parting) -> None:
        self.assumed, self.rows, self.base = assumed, rows, base
        self.quick = replay(assumed, rows, (QUICK,))
        self.known: dict[tuple[str, int], Parting] = {}
        self.longer: set[str] = set()

    def parting(self, name: str, raw: int) -> Parting:
        """Parting with another stored value of a parameter."""
        if (name, raw) not in self.known:
            self.known[name, raw] = self._replayed(self.assumed.with_raw(name, raw), name)
        return self.known[name, raw]

    def _replayed(self, assumed: AssumedFirmware, name: str) -> Parting:
        """A quick attempt; all of them where one of its values has given a longer replay than the
        assumed firmware.
        """
        found = replay(assumed, self.rows, (QUICK,))
        if found.row > self.base.row:
            self.longer.add(name)
        thorough = name in self.longer and found.row < len(self.rows)
        return replay(assumed, self.rows) if thorough else found

    def score(self, name: str, raw: int) -> tuple[int, int]:
        """Quality of a value, larger is better: the number of rows that agree, and minus the error
        of the firmware's output in the first row that does not.
        """
        return self.parting(name, raw).row, -abs(self._miss(name, raw))

    def agrees(self, name: str, raw: int) -> bool:
        """Whether all rows agree with this value."""
        return self.parting(name, raw).row >= len(self.rows)

    def found(self) -> FoundParameter | None:
        """The parameter with which the firmware gives all rows, None where there is none. Those
        that extend the replay most are searched first.
        """
        best = []
        for entry in telemetry.parameter_list():
            if _acts_in(entry.name, self.assumed.mode) and self._acts(entry):
                values = self._values(entry, FACTORS + SCREEN)
                best.append((self._rank(entry.name, values), entry))
        best.sort(key=lambda pair: pair[0], reverse=True)
        longest = [entry for rank, entry in best[:REFINED] if rank[0][0] >= self.base.row]
        return next((f for f in map(self._refined, longest) if f), None)

    def _rank(self, name: str, values: list[int]) -> tuple[tuple[int, int], int, int]:
        """The best score of values in order, whether a neighbour misses the log on the other side,
        and the value.
        """
        ranks = []
        for at, value in enumerate(values):
            around = (values[max(at - 1, 0)], values[min(at + 1, len(values) - 1)])
            edge = max(self._edge(name, value, other) for other in around)
            ranks.append((self.score(name, value), edge, value))
        return max(ranks)

    def _bracket(self, name: str, values: list[int], best: int) -> tuple[int, int]:
        """The neighbours of the best value; the value itself where the other one is opposite."""
        at = values.index(best)
        low, high = values[max(at - 1, 0)], values[min(at + 1, len(values) - 1)]
        if self._edge(name, best, low) == 2 and self.parting(name, low).row >= self.base.row:
            return low, best
        if self._edge(name, best, high) == 2 and self.parting(name, high).row >= self.base.row:
            return best, high
        return low, high

    def _edge(self, name: str, value: int, other: int) -> int:
        """0: the replays with two values are alike; 2: they miss the log on its two sides; 1:
        others.
        """
        if self.parting(name, value) == self.parting(name, other):
            return 0
        return 2 if self._miss(name, value) * self._miss(name, other) < 0 else 1

    def _miss(self, name: str, raw: int) -> int:
        """The firmware's value less the log's, where they part."""
        found = self.parting(name, raw)
        if found.row >= len(self.rows):
            return 0
        column = COMPARE if found.signal == "duty" else STATE
        return found.expected - int(self.rows[found.row, column])

    def _values(self, entry: telemetry.Parameter, factors: tuple[float, ...]) -> list[int]:
        assumed = self.assumed.raw(entry.name)
        values = [round(assumed * factor) for factor in factors]
        if assumed == 0:
            values = np.linspace(entry.minimum, entry.maximum, ZERO_STEPS).astype(int).tolist()
        values = {int(np.clip(v, entry.minimum, entry.maximum)) for v in values}
        return sorted(values - {assumed})

    def _acts(self, entry: telemetry.Parameter) -> bool:
        return any(self.parting(entry.name, v) != self.quick for v in self._values(entry, SCREEN))

    def _refined(self, entry: telemetry.Parameter) -> FoundParameter | None:
        """The value with which all rows agree, between two whose replays are long and miss the log
        on its two sides, or next to the value of the longest replay.
        """
        values = sorted({*self._values(entry, FACTORS + SCREEN), self.assumed.raw(entry.name)})
        best = self._rank(entry.name, values)[2]
        while not self.agrees(entry.name, best):
            low, high = self._bracket(entry.name, values, best)
            inner = {*_between(low, best), *_between(best, high)}
            if not inner:
                return None
            values = sorted({low, best, high, *inner})
            best = self._rank(entry.name, values)[2]
        ends = [
            _last_agreeing(lambda raw: self.agrees(entry.name, raw), best, end)
            for end in (entry.minimum, entry.maximum)
        ]
        return FoundParameter(entry.name, _middle(*ends), *ends)


def _acts_in(name: str, mode: str) -> bool:
    """Whether a parameter may act in a mode: those of a controller begin with the mode's name."""
    others = set(telemetry.value_table("STATE", "mode").values()) - {mode}
    prefixes = (*NOT_SEARCHED, *(f"{other}_" for other in others))
    return not name.startswith(prefixes)


def _between(low: int, high: int) -> list[int]:
    inner = np.linspace(low, high, INNER + 2)[1:-1].astype(int).tolist()
    return [value for value in inner if low < value < high]


def _last_agreeing(agrees: Callable[[int], bool], first: int, end: int) -> int:
    """The last value from `first` towards `end` that agrees: doubled steps, then bisection."""
    sign, step, good = (1 if end > first else -1), 1, first
    while good != end:
        tried = good + sign * min(step, abs(end - good))
        if not agrees(tried):
            bad = tried
            break
        good, step = tried, 2 * step
    else:
        return good
    while abs(bad - good) > 1:
        tried = (good + bad) // 2
        good, bad = (tried, bad) if agrees(tried) else (good, tried)
    return good


def _middle(low: int, high: int) -> int:
    return (low + high) // 2
