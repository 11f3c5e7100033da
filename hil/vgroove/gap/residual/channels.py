"""Channels: one measured signal each, and how the model's rows turn into what that signal shows."""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from vgroove.units import RAD_S_PER_RPM

CLOCK = "clock"  # (B,): seconds of the logger in a second of the tool
# (B, rows): what an encoder shows that is not the speed sensor
ENCODER = ("encoder_angle_rad", "encoder_speed_rad_s")
SPEED_SENSOR = ("angle_measured_rad", "speed_measured_rad_s")
DROPS_EDGES = "drops_edges"  # (B,): the parameter set's Hall sensor misses edges
MOST_PITCHES = 5.0  # that a sensor which drops edges takes for one
Simulation = dict[str, np.ndarray]  # (B, rows) arrays of vgroove._core.simulate_log


@dataclass(frozen=True)
class InterpolationPoints:
    """Instants (m,) between rows, for cubic Hermite interpolation: row at the interval's end, share
    of it that has passed, its length.
    """

    row: np.ndarray
    share: np.ndarray
    length_s: np.ndarray

    @staticmethod
    def of(time_s: np.ndarray, instants_s: np.ndarray) -> "InterpolationPoints":
        """Places of instants between a log's rows; those before the first row are moved to it."""
        row = np.clip(np.searchsorted(time_s, instants_s, side="left"), 1, len(time_s) - 1)
        length = time_s[row] - time_s[row - 1]
        return InterpolationPoints(
            row, np.clip((instants_s - time_s[row - 1]) / length, 0.0, 1.0), length
        )

    def __getitem__(self, keep: np.ndarray) -> "InterpolationPoints":
        return InterpolationPoints(self.row[keep], self.share[keep], self.length_s[keep])

    def shares(self) -> tuple[np.ndarray, np.ndarray]:
        """Shares (2, m) of the angles of the rows before and after an instant, and of their speeds,
        in the angle there (Hermite).
        """
        f, g = self.share, 1.0 - self.share
        return np.stack([g * g * (1.0 + 2.0 * f), f * f * (3.0 - 2.0 * f)]), np.stack([g, -f]) * (
            self.length_s * f * g
        )

    def weights(self, rows: int) -> list[csr_array]:
        """Weights (m, rows) of the rows' angles and of their speeds in the angle at the instants."""
        at = (
            np.repeat(np.arange(len(self.row)), 2),
            np.column_stack([self.row - 1, self.row]).ravel(),
        )
        return [
            csr_array((share.T.ravel(), at), shape=(len(self.row), rows)) for share in self.shares()
        ]

    def angle(self, simulation: Simulation, sensor: tuple[str, str] = SPEED_SENSOR) -> np.ndarray:
        """Measured angle (B, m) of the model at the instants."""
        value, slope = (
            before * simulation[name].take(self.row - 1, axis=1)
            + after * simulation[name].take(self.row, axis=1)
            for name, (before, after) in zip(sensor, self.shares(), strict=True)
        )
        if CLOCK in simulation:
            slope = slope / simulation[CLOCK][:, None]  # radians in a second of the logger
        return value + slope


@dataclass(frozen=True)
class Channel:
    """One judged signal of one log: rows (m,), their times, measured values and sigmas in the
    signal's unit.

    conditional: (m,) rows that say only that no edge came: they count where the model would have
    passed one. impulse: (m,) 1 sigma of an offset that all rows of one passage (m,), in order,
    share and that no model knows.
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
    passage: np.ndarray | None = None
    impulse: np.ndarray | None = None

    def first_row(self) -> np.ndarray:
        """Row (m,) before the first that each value depends on; a restart after it and up to `row`
        cuts the value in two.
        """
        return self.row - 1

    def kept(self, keep: np.ndarray) -> "Channel":
        """The channel with a part of its rows."""
        many = {f.name: _part(getattr(self, f.name), keep) for f in fields(self)}
        return replace(self, **many)

    def model(self, simulation: Simulation) -> np.ndarray:
        """What the model shows in this channel (B, m), in the signal's unit."""
        raise NotImplementedError

    def compared(self, simulation: Simulation) -> np.ndarray:
        """What the measurement is compared with (B, m): the model, and of offsets that no model
        knows what makes the residuals white.
        """
        model = self.model(simulation)
        return model if self.impulse is None else model + self._offset(self.measured - model)

    def _offset(self, error: np.ndarray) -> np.ndarray:
        """Part (B, m) of the errors (B, m) that is taken for the shared offsets: with s = impulse /
        sigma, the residuals r - s k (s.r) of noise of covariance 1 + s s' have covariance 1.
        """
        first = np.flatnonzero(np.diff(self.passage, prepend=self.passage[0] - 1))
        share = self.impulse / self.sigma**2
        seen = np.add.reduceat(self.impulse * share, first)
        found = np.add.reduceat(error * share, first, axis=1)
        weight = np.where(
            seen > 0.0, (1.0 - 1.0 / np.sqrt(1.0 + seen)) / np.where(seen > 0.0, seen, 1.0), 0.0
        )
        return self.impulse * np.repeat(
            weight * found, np.diff(np.append(first, len(self.passage))), axis=1
        )


def _part(value: Any, keep: np.ndarray) -> Any:
    if isinstance(value, tuple):
        return tuple(_part(item, keep) for item in value)
    return value[keep] if isinstance(value, np.ndarray | InterpolationPoints) else value


@dataclass(frozen=True)
class RowChannel(Channel):
    """A sample per row: current and bus as means over the row, a speed at its end."""

    key: str = ""
    factor: float = 1.0

    def model(self, simulation: Simulation) -> np.ndarray:
        values = simulation[self.key][:, self.row] * self.factor
        return np.abs(values) if self.magnitude else values


@dataclass(frozen=True)
class SpanChannel(Channel):
    """A mean speed over a span between two instants: the difference quotient of the measured angle.

    missed (m,): edges that seem to have been passed unseen in the span. A model whose Hall sensor
    drops edges shows one pitch for all.
    """

    start: InterpolationPoints | None = None
    end: InterpolationPoints | None = None
    length_s: np.ndarray | None = None
    missed: np.ndarray | None = None
    factor: float = 1.0
    sensor: tuple[str, str] = SPEED_SENSOR

    def first_row(self) -> np.ndarray:
        return self.start.row - 1

    @cached_property
    def weights(self) -> tuple[csr_array, csr_array]:
        """Weights (m, rows) of the rows' angles, and of their speeds in radians a second of the
        logger, in the mean speed.
        """
        rows = int(max(self.start.row.max(), self.end.row.max())) + 1
        found = [
            end - start
            for start, end in zip(self.start.weights(rows), self.end.weights(rows), strict=True)
        ]
        return tuple(
            csr_array(one.multiply((self.factor / self.length_s)[:, None])) for one in found
        )

    @cached_property
    def waiting(self) -> np.ndarray:
        """Places (k,) of the rows that wait for an edge."""
        return np.flatnonzero(self.conditional)

    def mean_speed(self, simulation: Simulation) -> np.ndarray:
        """Mean of the model's speed (B, m) over the spans."""
        angle, speed = (simulation[name] for name in self.sensor)
        by_angle, by_speed = self.weights
        clock, rows = simulation.get(CLOCK, np.ones(len(angle))), by_angle.shape[1]
        return np.stack(
            [
                by_angle @ a[:rows] + (by_speed @ w[:rows]) / c
                for a, w, c in zip(angle, speed, clock, strict=True)
            ]
        )

    def pitches(self, mean: np.ndarray) -> np.ndarray:
        """Pitches (B, m) that a sensor which drops edges takes for one: as many as the model's mean
        speed (B, m) asks for.
        """
        return np.clip(
            np.round(np.abs(mean) / np.maximum(np.abs(self.measured), 1e-9)), 1.0, MOST_PITCHES
        )

    def model(self, simulation: Simulation) -> np.ndarray:
        mean = self.mean_speed(simulation)
        if self.edges and CLOCK in simulation:
            # edge periods are timed by the sensor's clock, spans lie on the logger's
            mean *= simulation[CLOCK][:, None]
        drops = (
            simulation[DROPS_EDGES][:, None]
            if self.missed is not None and DROPS_EDGES in simulation
            else np.zeros((1, 1), bool)
        )
        if drops.any():
            mean = np.where(drops, mean / self.pitches(mean), mean)
        if len(self.waiting):
            mean[:, self.waiting] = self.waited(mean[:, self.waiting], drops)
        return mean

    def waited(self, mean: np.ndarray, drops: np.ndarray) -> np.ndarray:
        """What rows that wait for an edge show of a model's mean speed (B, k) over the wait: they
        state the most that it can have been, and no difference below that; of a sensor that drops
        edges (B, 1) they say nothing.
        """
        measured = self.measured[self.waiting]
        beyond = np.abs(mean) - np.abs(measured)
        return np.where(drops | (beyond <= 0.0), measured, measured + beyond)


@dataclass(frozen=True)
class ForceChannel(Channel):
    """Acceleration between three instants, the second difference of the angle: force compared with
    force where the input is a force.
    """

    places: tuple[InterpolationPoints, InterpolationPoints, InterpolationPoints] | None = None
    length_s: np.ndarray | None = None

    def first_row(self) -> np.ndarray:
        return self.places[0].row - 1

    def model(self, simulation: Simulation) -> np.ndarray:
        first, middle, last = (place.angle(simulation, ENCODER) for place in self.places)
        return (last - 2.0 * middle + first) / self.length_s**2


def span_channel(
    column: str,
    unit: str,
    log_time_s: np.ndarray,
    spans: tuple[np.ndarray, np.ndarray],
    row: np.ndarray,
    measured: np.ndarray,
    sigma: np.ndarray,
    conditional: np.ndarray,
    factor: float,
    edges: bool,
    note: str,
) -> SpanChannel:
    """A channel of mean speeds over spans (start_s, end_s); factor turns rad/s into the signal's
    unit.
    """
    start, end = spans
    return SpanChannel(
        column,
        unit,
        row,
        0.5 * (start + end),
        measured,
        sigma,
        conditional,
        edges=edges,
        note=note,
        start=InterpolationPoints.of(log_time_s, start),
        end=InterpolationPoints.of(log_time_s, end),
        length_s=end - start,
        factor=factor,
    )


def show_encoder(simulation: Simulation, gain: np.ndarray, lag_s: np.ndarray) -> None:
    """Add what an encoder shows to a simulation: the eccentric wheel, but neither gain nor lag (B,)
    of the speed sensor.
    """
    apart = (gain != 1.0) | (lag_s > 0.0)
    for name, sensor, shaft in zip(
        ENCODER, SPEED_SENSOR, ("angle_rad", "speed_rad_s"), strict=True
    ):
        simulation[name] = (
            np.where(apart[:, None], simulation[shaft], simulation[sensor])
            if apart.any()
            else simulation[sensor]
        )


RAD_S_TO_RPM = 1.0 / RAD_S_PER_RPM
