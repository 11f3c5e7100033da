"""Columns that a logger writes of a run, and the difference of two runs in units of the sensors'
noise.
"""

from dataclasses import dataclass

import numpy as np
from truth import Run

RPM_PER_RAD_S = 60.0 / (2.0 * np.pi)
COUNTING_EDGES = 16  # from so many edges a turn on the sensor counts edges between rows
CLIP = 10.0  # of a deviation, in sigma


@dataclass(frozen=True)
class Sensors:
    """Section [sensors] of a rig, and the errors of the logger; a tachometer has
    hall_pulses_per_rev 0 and speed_noise_rpm above 0.
    """

    log_hz: float = 1000.0
    current_noise_a: float = 0.15
    current_lsb_a: float = 0.1
    supply_noise_v: float = 0.02
    supply_lsb_v: float = 0.02
    speed_lsb_rpm: float = 0.5
    hall_pulses_per_rev: int = 4
    hall_timeout_s: float = 0.05
    edge_jitter_s: float = 2e-7
    speed_gain: float = 0.0
    speed_lag_s: float = 0.0
    speed_delay_s: float = 0.0
    speed_lag2_s: float = 0.0
    speed_noise_rpm: float = 0.0
    position_lsb_rad: float = 0.0


def hall_rows(run: Run, sensors: Sensors) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each row (n,): speed in rad/s (one pitch over the last edge period), time of the last
    edge, and that period; time and period are nan without one.
    """
    pitch = 2.0 * np.pi / sensors.hall_pulses_per_rev
    last = np.searchsorted(run.edge_s, run.time_s, side="right") - 1
    periods = np.diff(run.edge_s, prepend=-np.inf)
    has = last >= 1
    at = np.where(has, run.edge_s[np.maximum(last, 0)] if len(run.edge_s) else 0.0, -np.inf)
    period = np.where(has, periods[np.maximum(last, 0)] if len(run.edge_s) else np.inf, np.inf)
    since_edge = run.time_s - at
    steps = np.ones(len(run.time_s))
    if sensors.hall_pulses_per_rev >= COUNTING_EDGES:
        period, steps = counted(run, last, period)
    shown = np.maximum(period, since_edge)
    alive = has & (shown <= sensors.hall_timeout_s)
    direction = (
        run.edge_direction[np.maximum(last, 0)] if len(run.edge_s) else np.ones(len(run.time_s))
    )
    pitches = np.where(since_edge > period, 1.0, steps)
    speed = np.where(
        alive, direction * pitches * pitch / np.where(alive, np.maximum(shown, 1e-9), 1.0), 0.0
    )
    fresh = alive & (since_edge <= period)
    return speed, np.where(fresh, at, np.nan), np.where(fresh, period, np.nan)


def counted(run: Run, last: np.ndarray, period: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(time, number of edges) between the last edge of a row and that of the row before, (n,)
    each.
    """
    before = np.concatenate([[-1], last[:-1]])
    moved = (last > before) & (before >= 0)
    safe = np.maximum(before, 0)
    time = np.where(moved, run.edge_s[np.maximum(last, 0)] - run.edge_s[safe], period)
    return time, np.where(moved, last - before, 1).astype(float)


def speed_column(run: Run, sensors: Sensors) -> np.ndarray:
    """Logged speed (n,) in rad/s, with gain, lag and delay of the sensor."""
    speed = hall_rows(run, sensors)[0] if sensors.hall_pulses_per_rev else run.speed_rad_s
    speed = speed * (1.0 + sensors.speed_gain)
    if sensors.speed_delay_s > 0.0:
        late = (
            np.searchsorted(run.time_s, run.time_s - sensors.speed_delay_s + 1e-9, side="right") - 1
        )
        speed = np.where(late >= 0, speed[np.maximum(late, 0)], 0.0)
    for lag_s in (sensors.speed_lag_s, sensors.speed_lag2_s):
        if lag_s > 0.0:
            speed = lagged(run, speed, lag_s)
    return speed


def lagged(run: Run, values: np.ndarray, lag_s: float) -> np.ndarray:
    """Values (n,) after a first-order low-pass filter."""
    keep, out, value = (
        np.exp(-np.diff(run.time_s, prepend=run.begin_s) / lag_s),
        np.empty_like(values),
        0.0,
    )
    for n in range(len(values)):
        value = values[n] + (value - values[n]) * keep[n]
        out[n] = value
    return out


def noisy(run: Run, sensors: Sensors, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """The measured columns supply_v, current_a and speed_rpm, with noise and resolution."""

    def steps(values: np.ndarray, lsb: float) -> np.ndarray:
        return np.round(values / lsb) * lsb if lsb > 0 else values

    n = len(run.time_s)
    current = steps(
        run.current_a + sensors.current_noise_a * rng.standard_normal(n), sensors.current_lsb_a
    )
    supply = steps(
        run.supply_v + sensors.supply_noise_v * rng.standard_normal(n), sensors.supply_lsb_v
    )
    noise = (
        sensors.speed_noise_rpm * rng.standard_normal(n) if sensors.speed_noise_rpm > 0.0 else 0.0
    )
    speed = steps(speed_column(run, sensors) * RPM_PER_RAD_S + noise, sensors.speed_lsb_rpm)
    return {"supply_v": supply, "current_a": current, "speed_rpm": speed}


def _angle_at(run: Run, t: np.ndarray) -> np.ndarray:
    """Shaft angle between rows by cubic Hermite interpolation of the noiseless angle and speed."""
    time = np.concatenate([[run.begin_s], run.time_s])
    angle = np.concatenate([[0.0], run.angle_rad])
    speed = np.concatenate([[0.0], run.speed_rad_s])
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(time) - 2)
    h = time[k + 1] - time[k]
    x = np.clip((t - time[k]) / h, 0.0, 1.0)
    return (
        (1 + 2 * x) * (1 - x) ** 2 * angle[k]
        + x * (1 - x) ** 2 * h * speed[k]
        + x * x * (3 - 2 * x) * angle[k + 1]
        + x * x * (x - 1) * h * speed[k + 1]
    )


def deviations(
    measured: Run, model: Run, sensors: Sensors, model_sensors: Sensors
) -> dict[str, np.ndarray]:
    """(measured - model) / sigma of each signal without noise; speeds over the measured edge
    periods, once for each edge.
    """
    out = {
        "current_a": (measured.current_a - model.current_a)
        / np.hypot(sensors.current_noise_a, sensors.current_lsb_a / 12**0.5),
        "supply_v": (measured.supply_v - model.supply_v)
        / np.hypot(sensors.supply_noise_v, sensors.supply_lsb_v / 12**0.5),
    }
    _, at, period = hall_rows(measured, sensors)
    speed = speed_column(measured, sensors)
    fresh = ~np.isnan(at) & (np.diff(np.where(np.isnan(at), -1.0, at), prepend=-1.0) != 0)
    at, period, speed = at[fresh], period[fresh], np.abs(speed[fresh])
    modelled = (
        np.abs(_angle_at(model, at) - _angle_at(model, at - period))
        / period
        * (1.0 + model_sensors.speed_gain)
    )
    sigma = np.hypot(
        sensors.speed_lsb_rpm / RPM_PER_RAD_S / 12**0.5,
        speed * 2**0.5 * sensors.edge_jitter_s / period,
    )
    out["speed_rpm"] = (speed - modelled) / sigma
    return out


def gap(found: dict[str, np.ndarray]) -> float:
    """RMS over all signals and samples, each clipped at CLIP."""
    return float(np.sqrt(np.mean(np.clip(np.concatenate(list(found.values())), -CLIP, CLIP) ** 2)))
