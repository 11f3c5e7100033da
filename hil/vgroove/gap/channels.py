"""Channels: one measured signal each, and how the model's rows turn into what that signal shows."""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.noise import RPM

Simulation = dict[str, np.ndarray]  # (B, rows) arrays of vgroove._core.simulate_log


@dataclass(frozen=True)
class Places:
    """Instants (m,) as a row, the share of its interval that has passed, and the interval's length: ready for cubic Hermite interpolation."""

    row: np.ndarray
    share: np.ndarray
    length_s: np.ndarray

    @staticmethod
    def of(time_s: np.ndarray, instants_s: np.ndarray) -> "Places":
        """Places of instants between a log's rows; those before the first row are moved to its interval's start."""
        ends = np.concatenate([[2.0 * time_s[0] - time_s[1]], time_s])
        row = np.clip(np.searchsorted(ends, instants_s, side="left") - 1, 0, len(time_s) - 1)
        length = ends[row + 1] - ends[row]
        return Places(row, np.clip((instants_s - ends[row]) / length, 0.0, 1.0), length)


@dataclass(frozen=True)
class Motion:
    """Measured angle and speed of the model over a log, made continuous across restarts.

    angle: (B, rows + 1), entry r + 1 at the end of row r; begin, end: (B, rows) speed at the borders of each row's interval.
    """

    angle: np.ndarray
    begin: np.ndarray
    end: np.ndarray

    @staticmethod
    def of(simulation: Simulation, starts: np.ndarray, states: np.ndarray) -> "Motion":
        """Motion behind a simulation that restarted at rows `starts` (S,) from `states` (S, 3)."""
        angle, end = simulation["angle_measured_rad"], simulation["speed_measured_rad_s"]
        rows = angle.shape[1]
        before = np.concatenate([np.broadcast_to(states[:1, 2], (angle.shape[0], 1)), angle], axis=1)
        lag = simulation["angle_rad"][:, starts] - angle[:, starts]
        jump = before[:, starts] - (states[:, 2] - lag)
        jump[:, 0] = 0.0
        shift = np.cumsum(jump, axis=1)
        window = np.searchsorted(starts, np.arange(rows), side="right") - 1
        whole = np.concatenate([before[:, :1], angle + shift[:, window]], axis=1)
        begin = np.concatenate([end[:, :1], end[:, :-1]], axis=1)
        begin[:, starts] = states[:, 1]
        return Motion(whole, begin, end)

    def angle_at(self, places: Places) -> np.ndarray:
        """Angle (B, m) at instants, cubic Hermite."""
        f = places.share
        g = 1.0 - f
        left, right = self.angle[:, places.row], self.angle[:, places.row + 1]
        slope = places.length_s * f * g * (g * self.begin[:, places.row] - f * self.end[:, places.row])
        return left * (g * g * (1.0 + 2.0 * f)) + right * (f * f * (3.0 - 2.0 * f)) + slope


@dataclass(frozen=True)
class Channel:
    """One judged signal of one log: rows (m,), their times, measured values and sigmas in the signal's unit.

    conditional: (m,) rows that say only that no edge came: they count where the model would have passed one.
    """

    column: str
    unit: str
    row: np.ndarray
    time_s: np.ndarray
    measured: np.ndarray
    sigma: np.ndarray
    conditional: np.ndarray
    edges: bool = False
    magnitude: bool = False
    note: str = ""

    def model(self, simulation: Simulation, motion: Motion | None) -> np.ndarray:
        """What the model shows in this channel (B, m), in the signal's unit."""
        raise NotImplementedError


@dataclass(frozen=True)
class RowChannel(Channel):
    """A sample per row: current and bus as means over the row, a speed at its end."""

    key: str = ""
    factor: float = 1.0

    def model(self, simulation: Simulation, motion: Motion | None) -> np.ndarray:
        values = simulation[self.key][:, self.row] * self.factor
        return np.abs(values) if self.magnitude else values


@dataclass(frozen=True)
class SpanChannel(Channel):
    """A mean speed over a span between two instants: the difference quotient of the measured angle."""

    start: Places | None = None
    end: Places | None = None
    length_s: np.ndarray | None = None
    factor: float = 1.0

    def model(self, simulation: Simulation, motion: Motion | None) -> np.ndarray:
        mean = (motion.angle_at(self.end) - motion.angle_at(self.start)) * (self.factor / self.length_s)
        if not self.conditional.any():
            return mean
        # While an edge is awaited the row states the most that the speed can have been: no difference below that.
        limit = np.abs(self.measured)
        waited = np.where(np.abs(mean) > limit, self.measured + np.abs(mean) - limit, self.measured)
        return np.where(self.conditional, waited, mean)


@dataclass(frozen=True)
class ForceChannel(Channel):
    """Acceleration between three instants, the second difference of the angle: force compared with force where the input is a force."""

    places: tuple[Places, Places, Places] | None = None
    length_s: np.ndarray | None = None

    def model(self, simulation: Simulation, motion: Motion | None) -> np.ndarray:
        first, middle, last = (motion.angle_at(place) for place in self.places)
        return (last - 2.0 * middle + first) / self.length_s**2


def span_channel(column: str, unit: str, log_time_s: np.ndarray, spans: tuple[np.ndarray, np.ndarray], row: np.ndarray,
                 measured: np.ndarray, sigma: np.ndarray, conditional: np.ndarray, factor: float, edges: bool, note: str = "") -> SpanChannel:
    """A channel of mean speeds over spans (start_s, end_s); factor turns rad/s into the signal's unit."""
    start, end = spans
    return SpanChannel(column, unit, row, 0.5 * (start + end), measured, sigma, conditional, edges=edges, note=note,
                       start=Places.of(log_time_s, start), end=Places.of(log_time_s, end), length_s=end - start, factor=factor)


RAD_S_TO_RPM = 1.0 / RPM
