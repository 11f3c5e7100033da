"""Command profiles of the cases, as a test bench or a hand on the trigger makes them, and bench
loads.
"""

from dataclasses import dataclass, field

import numpy as np
from truth import Command

NAMES = ("staircase", "ramps", "reversals", "load_steps", "hand", "stop_and_go", "chirp", "crawl")
BENCH_NAMES = (*NAMES, "coast_down")  # of the blind set


@dataclass(frozen=True)
class Profile:
    """Targets (n,) of the duty that hold from their times on, or points of a curve (`smooth`);
    whether the bridge opens at zero duty; points (m,) of the load.
    """

    name: str
    time_s: np.ndarray
    duty: np.ndarray
    smooth: bool = False
    coast_at_zero: bool = False
    load_time_s: np.ndarray = field(default_factory=lambda: np.zeros(0))
    load_nm: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def two_way(self) -> bool:
        return bool(self.duty.min() < 0.0 < self.duty.max())


def draw(name: str, seconds: float, load_nm: float, rng: np.random.Generator) -> Profile:
    """A profile by its name, `seconds` long; `load_nm` scales the loads of a profile with loads."""
    made = {
        "staircase": _staircase,
        "ramps": _ramps,
        "reversals": _reversals,
        "load_steps": _load_steps,
        "hand": _hand,
        "stop_and_go": _stop_and_go,
        "chirp": _chirp,
        "crawl": _crawl,
        "coast_down": _coast_down,
    }[name]
    return made(seconds, load_nm, rng)


def _times(seconds: float, dwell: float, rng: np.random.Generator) -> np.ndarray:
    """Times (n,) of changes about `dwell` apart, from 0.2 s after the start to 0.4 s before the
    end.
    """
    count = max(3, round((seconds - 0.6) / dwell))
    return 0.2 + (seconds - 0.6) / count * (np.arange(count) + rng.uniform(0.0, 0.3, count))


def _holding(
    name: str, times: np.ndarray, levels: np.ndarray, seconds: float, **more: object
) -> Profile:
    return Profile(
        name,
        np.concatenate([[0.0], times, [seconds - 0.25]]),
        np.concatenate([[0.0], levels, [0.0]]),
        **more,
    )


def _staircase(seconds: float, _: float, rng: np.random.Generator) -> Profile:
    times = _times(seconds, 0.55, rng)
    half = (len(times) + 1) // 2
    up = np.linspace(rng.uniform(0.15, 0.3), rng.uniform(0.85, 1.0), half)
    down = rng.permutation(np.linspace(0.25, 0.9, len(times) - half))
    return _holding("staircase", times, np.concatenate([up, down]), seconds)


def _ramps(seconds: float, _: float, rng: np.random.Generator) -> Profile:
    times = _times(seconds, 0.35, rng)
    levels = rng.uniform(0.12, 1.0, len(times))
    points = np.concatenate([[0.0, 0.2], times + 0.05, [seconds - 0.1]])
    return Profile("ramps", points, np.concatenate([[0.0, 0.0], levels, [0.0]]), smooth=True)


def _reversals(seconds: float, load_nm: float, rng: np.random.Generator) -> Profile:
    times = _times(seconds, 0.5, rng)
    way = np.where(np.arange(len(times)) // 2 % 2 == 0, 1.0, -1.0)
    loads = _loads(seconds, load_nm, rng) if rng.uniform() < 0.5 else (np.zeros(0), np.zeros(0))
    return _holding(
        "reversals",
        times,
        way * rng.uniform(0.2, 1.0, len(times)),
        seconds,
        load_time_s=loads[0],
        load_nm=loads[1],
    )


def _load_steps(seconds: float, load_nm: float, rng: np.random.Generator) -> Profile:
    times = _times(seconds, 0.8, rng)
    loads = _loads(seconds, load_nm, rng)
    return _holding(
        "load_steps",
        times,
        rng.uniform(0.35, 1.0, len(times)),
        seconds,
        load_time_s=loads[0],
        load_nm=loads[1],
    )


def _loads(
    seconds: float, load_nm: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Times and levels of a load torque that switches on and off over ramps of 30 ms."""
    times, levels, level = [0.0], [0.0], 0.0
    for at in _times(seconds, 0.7, rng) + 0.2:
        wanted = 0.0 if level > 0.0 and rng.uniform() < 0.6 else load_nm * rng.uniform(0.3, 1.0)
        times += [at, at + 0.03]
        levels += [level, wanted]
        level = wanted
    return np.array([*times, seconds - 0.1, seconds - 0.05]), np.array([*levels, level, 0.0])


def _hand(seconds: float, _: float, rng: np.random.Generator) -> Profile:
    """A finger on the trigger: presses with overshoot, tremor at about 8 Hz, and releases."""
    t = np.arange(0.0, seconds, 0.02)
    presses = _pressed(t, seconds, rng)
    tremor = 0.03 * np.convolve(rng.standard_normal(len(t) + 4), np.hanning(5), "valid")
    duty = np.clip(np.where(presses > 0.02, presses + tremor, presses), 0.0, 1.0)
    return Profile("hand", t, duty, smooth=True)


def _pressed(t: np.ndarray, seconds: float, rng: np.random.Generator) -> np.ndarray:
    out = np.zeros(len(t))
    at = rng.uniform(0.2, 0.4)
    while at < seconds - 0.7:
        hold, level, rise = rng.uniform(0.5, 1.4), rng.uniform(0.3, 1.05), rng.uniform(0.06, 0.2)
        end = min(at + hold, seconds - 0.3)
        shape = np.clip((t - at) / rise, 0.0, 1.0) * np.clip((end + 0.1 - t) / 0.1, 0.0, 1.0)
        out += level * (shape + 0.08 * np.exp(-(((t - at - rise) / 0.05) ** 2)))
        at = end + rng.uniform(0.25, 0.6)
    return out


def _stop_and_go(seconds: float, _: float, rng: np.random.Generator) -> Profile:
    times = _times(seconds, 0.45, rng)
    levels = np.where(np.arange(len(times)) % 2 == 0, rng.uniform(0.3, 1.0, len(times)), 0.0)
    return _holding("stop_and_go", times, levels, seconds, coast_at_zero=bool(rng.uniform() < 0.5))


def _coast_down(seconds: float, _: float, rng: np.random.Generator) -> Profile:
    """Driven up to a speed, then the bridge is open for about as long."""
    times = _times(seconds, 0.8, rng)
    levels = np.where(np.arange(len(times)) % 2 == 0, rng.uniform(0.3, 1.0, len(times)), 0.0)
    return _holding("coast_down", times, levels, seconds, coast_at_zero=True)


def _crawl(seconds: float, _: float, rng: np.random.Generator) -> Profile:
    """Slow running, where Stribeck friction acts, with a fast part in every fourth step."""
    times = _times(seconds, 0.6, rng)
    levels = np.where(
        np.arange(len(times)) % 4 == 3,
        rng.uniform(0.4, 0.9, len(times)),
        rng.uniform(0.04, 0.14, len(times)),
    )
    return _holding("crawl", times, levels, seconds)


def _chirp(seconds: float, _: float, rng: np.random.Generator) -> Profile:
    t = np.arange(0.0, seconds, 0.01)
    span = max(seconds - 0.8, 1.0)
    x = np.clip(t - 0.3, 0.0, span)
    slow, fast = rng.uniform(0.2, 0.6), rng.uniform(2.5, 5.0)
    phase = 2 * np.pi * (slow * x + 0.5 * (fast - slow) * x * x / span)
    duty = rng.uniform(0.45, 0.6) - rng.uniform(0.2, 0.38) * np.cos(phase)
    fade = np.clip((t - 0.2) / 0.2, 0, 1) * np.clip((seconds - 0.2 - t) / 0.2, 0, 1)
    return Profile("chirp", t, duty * fade, smooth=True)


def slewed(times: np.ndarray, targets: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of the piecewise linear command that follows held targets at `rate` per
    second.
    """
    t_out, y_out, value = [0.0], [float(targets[0])], float(targets[0])
    for n, target in enumerate(targets):
        until = times[n + 1] if n + 1 < len(times) else times[n] + 10.0
        arrive = times[n] + abs(target - value) / rate
        t_out.append(float(times[n]))
        y_out.append(value)
        if arrive <= until:
            value = float(target)
            t_out.append(float(arrive))
        else:
            value += float(np.sign(target - value)) * rate * (until - times[n])
            t_out.append(float(until))
        y_out.append(value)
    return np.array(t_out), np.array(y_out)


def limited(times: np.ndarray, points: np.ndarray, rate: float) -> np.ndarray:
    """Points (n,) of a curve, limited to changes of `rate` per second."""
    out = points.astype(float).copy()
    for n in range(1, len(out)):
        change = rate * (times[n] - times[n - 1])
        out[n] = np.clip(points[n], out[n - 1] - change, out[n - 1] + change)
    return out


def snapped(times: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Times (n,) rounded up to those of a grid, so that a command changes between rows."""
    return grid[np.clip(np.searchsorted(grid, times), 0, len(grid) - 1)]


def command(profile: Profile, slew_per_s: float | None, grid: np.ndarray, levels: float) -> Command:
    """The command of the bridge: piecewise linear at the slew rate, or, without one, constant over
    each row of `grid`.

    The controller sets values of resolution 1 / levels at the times of `grid`; between them the
    slewed command is linear.
    """
    loads = (
        snapped(profile.load_time_s, grid) if len(profile.load_time_s) else profile.load_time_s,
        profile.load_nm,
    )
    if slew_per_s is None:
        values = (
            np.interp(grid, profile.time_s, profile.duty)
            if profile.smooth
            else profile.duty[np.searchsorted(profile.time_s, grid + 1e-9, side="right") - 1]
        )
        time, duty = np.repeat(grid, 2)[1:], np.repeat(values, 2)[:-1]
    elif profile.smooth:
        time, duty = profile.time_s, limited(profile.time_s, profile.duty, slew_per_s)
    else:
        time, duty = slewed(profile.time_s, profile.duty, slew_per_s)
    if slew_per_s is not None:
        time, duty = grid, np.interp(grid, time, duty)
    duty = np.round(duty * levels) / levels
    coast = np.zeros(len(time))
    if profile.coast_at_zero:
        coast = open_at_zero(time, duty)
    return Command(time, duty, coast, *loads)


def open_at_zero(time: np.ndarray, duty: np.ndarray) -> np.ndarray:
    """1 at the points where the command is zero and remains so, else 0, (n,)."""
    after = np.concatenate([duty[1:], [0.0]])
    return ((duty == 0.0) & (after == 0.0)).astype(float)


def sampled(times: np.ndarray, points: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The command just before each time of `at`."""
    return np.interp(at - 1e-7, times, points)


def held(times: np.ndarray, points: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The value of the last point before each time of `at`."""
    return points[np.clip(np.searchsorted(times, at - 1e-7, side="right") - 1, 0, len(points) - 1)]
