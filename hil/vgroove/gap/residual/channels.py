"""Channels: one measured signal of a log each, and the prediction of the model for it."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from vgroove.gap.hall_edges.missed_edges import MAX_PITCHES, near_missed
from vgroove.gap.residual.immutable import freeze_arrays
from vgroove.gap.residual.sensors import SensorErrors
from vgroove.gap.residual.shared_errors import SharedErrors

CLOCK = "clock"  # (B,): seconds of the logger in a second of the tool
# (B, rows): angle and speed as an encoder would measure them, besides the speed sensor's
ENCODER = ("encoder_angle_rad", "encoder_speed_rad_s")
SPEED_SENSOR = ("angle_measured_rad", "speed_measured_rad_s")
SHAFT = ("angle_rad", "speed_rad_s")
DROPS_EDGES = "drops_edges"  # (B,): whether the parameter set's Hall sensor misses edges
MIN_SPEED = 1e-9  # in the signal's unit; keeps a ratio of speeds finite
Simulation = dict[str, np.ndarray]  # (B, rows) arrays of vgroove._core.simulate_log


@dataclass(frozen=True)
class InterpolationPoints:
    """Instants (m,) between rows, for cubic Hermite interpolation of the angle (its derivative, the
    speed, is known at the rows; de Boor, A Practical Guide to Splines, chapter IV).
    """

    row: np.ndarray  # (m,) row at the end of the interval
    share: np.ndarray  # (m,) share 0..1 of the interval before the instant
    length_s: np.ndarray  # (m,) length of the interval

    @staticmethod
    def of(time_s: np.ndarray, instants_s: np.ndarray) -> "InterpolationPoints":
        """Instants (m,) between a log's rows; those before the first row are moved to it."""
        row = np.clip(np.searchsorted(time_s, instants_s, side="left"), 1, len(time_s) - 1)
        length = time_s[row] - time_s[row - 1]
        share = np.clip((instants_s - time_s[row - 1]) / length, 0.0, 1.0)
        return InterpolationPoints(row, share, length)

    def __getitem__(self, keep: np.ndarray) -> "InterpolationPoints":
        return InterpolationPoints(self.row[keep], self.share[keep], self.length_s[keep])

    def shares(self) -> tuple[np.ndarray, np.ndarray]:
        """Hermite weights (2, m) of the angle at each instant: those of the angles of the row
        before and the row after, and those of their speeds.
        """
        f, g = self.share, 1.0 - self.share
        of_angles = np.stack([g * g * (1.0 + 2.0 * f), f * f * (3.0 - 2.0 * f)])
        return of_angles, np.stack([g, -f]) * (self.length_s * f * g)

    def weights(self, rows: int) -> list[csr_array]:
        """The weights of shares() as sparse matrices (m, rows): of the rows' angles, of their
        speeds.
        """
        count = len(self.row)
        columns = np.column_stack([self.row - 1, self.row]).ravel()
        at = (np.repeat(np.arange(count), 2), columns)
        return [csr_array((share.T.ravel(), at), shape=(count, rows)) for share in self.shares()]

    def angle(self, simulation: Simulation, sensor: tuple[str, str] = SPEED_SENSOR) -> np.ndarray:
        """Angle (B, m) of the model at the instants, as a sensor would measure it."""
        value, slope = (
            before * simulation[name].take(self.row - 1, axis=1)
            + after * simulation[name].take(self.row, axis=1)
            for name, (before, after) in zip(sensor, self.shares(), strict=True)
        )
        if CLOCK in simulation:
            slope = slope / simulation[CLOCK][:, None]  # radians in a second of the logger
        return value + slope


@dataclass(frozen=True)
class Channel(ABC):
    """One judged signal of one log: m samples that end at rows of the log.

    A censored sample is only an upper bound of the speed: a timeout sample of a Hall sensor, one
    pitch divided by the time without an edge. It counts where the model exceeds the bound (censored
    data: Tobin, Econometrica 26 (1958) 24).
    """

    column: str
    unit: str
    row: np.ndarray  # (m,)
    time_s: np.ndarray  # (m,)
    measured: np.ndarray  # (m,) in the unit
    sigma: np.ndarray  # (m,) standard deviation in the unit
    censored: np.ndarray  # (m,) whether the sample is an upper bound
    edges: bool = False  # made from Hall edges
    magnitude: bool = False  # compared by magnitude
    note: str = ""
    shared: SharedErrors | None = None
    noise_is_known: bool = False  # sigma is that of a resolution which the rig states

    def __post_init__(self) -> None:
        freeze_arrays(self)

    def first_row(self) -> np.ndarray:
        """Row (m,) before the first that each sample depends on; a restart after it and up to `row`
        cuts the sample in two.
        """
        return self.row - 1

    def select(self, keep: np.ndarray) -> "Channel":
        """The channel with the samples of a mask (m,)."""
        return replace(self, **{f.name: _selected(vars(self)[f.name], keep) for f in fields(self)})

    @abstractmethod
    def model(self, simulation: Simulation) -> np.ndarray:
        """Prediction of the model for this channel (B, m), in the signal's unit."""

    def compared(self, simulation: Simulation) -> np.ndarray:
        """What the measurement is compared with (B, m): the model plus that part of the shared
        errors whose removal leaves the residuals uncorrelated.
        """
        model = self.model(simulation)
        return model if self.shared is None else model + self._shared(self.measured - model)

    @cached_property
    def _whitening(self) -> tuple[csr_array, csr_array]:
        return self.shared.projections()

    def _shared(self, error: np.ndarray) -> np.ndarray:
        """Part (B, m) of the errors (B, m) that is attributed to the shared errors."""
        onto, back = self._whitening
        return (back @ (onto @ (error / self.sigma).T)).T * self.sigma


def _selected(value: Any, keep: np.ndarray) -> Any:
    if isinstance(value, SharedErrors):
        return value.select(keep)
    if isinstance(value, tuple):
        return tuple(_selected(item, keep) for item in value)
    return value[keep] if isinstance(value, np.ndarray | InterpolationPoints) else value


@dataclass(frozen=True)
class RowChannel(Channel):
    """A sample per row: current and bus as means over the row, a speed at its end. It is compared
    with the column `key` of the simulation times `factor`.
    """

    key: str = ""
    factor: float = 1.0

    def model(self, simulation: Simulation) -> np.ndarray:
        values = simulation[self.key][:, self.row] * self.factor
        return np.abs(values) if self.magnitude else values


@dataclass(frozen=True)
class SpanChannel(Channel):
    """A mean speed over a span between two instants: the difference quotient of the sensor's angle
    times `factor`.

    missed (m,): estimated number of edges that the sensor missed in the span. For a parameter set
    whose Hall sensor misses edges, the predicted speed is one pitch divided by the whole span.
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
        pairs = zip(self.start.weights(rows), self.end.weights(rows), strict=True)
        quotient = (self.factor / self.length_s)[:, None]
        return tuple(csr_array((end - start).multiply(quotient)) for start, end in pairs)

    @cached_property
    def bounds(self) -> np.ndarray:
        """Indices (k,) of the censored samples."""
        return np.flatnonzero(self.censored)

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
        """Number of pitches (B, m) that a sensor which misses edges reports as one: mean speed of
        the model (B, m) over the measured speed, rounded. 1 where the measured speed beside shows
        that no edge was missed: else the sensor would explain a model that is several times too
        fast.
        """
        ratio = np.abs(mean) / np.maximum(np.abs(self.measured), MIN_SPEED)
        return np.where(self.may_miss, np.clip(np.round(ratio), 1.0, MAX_PITCHES), 1.0)

    @cached_property
    def may_miss(self) -> np.ndarray:
        """Whether the sensor may have missed an edge in a sample (m,): in that one or one near it
        the measured speed shows that one is missing.
        """
        return near_missed(self.missed)

    def model(self, simulation: Simulation) -> np.ndarray:
        mean = self.mean_speed(simulation)
        if self.edges and CLOCK in simulation:
            # edge periods are timed by the sensor's clock, spans lie on the logger's
            mean *= simulation[CLOCK][:, None]
        drops = np.zeros((1, 1), bool)
        if self.missed is not None and DROPS_EDGES in simulation:
            drops = simulation[DROPS_EDGES][:, None]
        if drops.any():
            mean = np.where(drops, mean / self.pitches(mean), mean)
        if len(self.bounds):
            mean[:, self.bounds] = self.bounded(mean[:, self.bounds], drops)
        return mean

    def bounded(self, mean: np.ndarray, drops: np.ndarray) -> np.ndarray:
        """Predictions of the censored samples from a model's mean speed (B, k): the measured bound,
        plus the excess of the model over it; the bound alone for a sensor that misses edges (drops
        (B, 1)), if any sample shows a missed one: that explains the excess.
        """
        measured = self.measured[self.bounds]
        excess = np.abs(mean) - np.abs(measured)
        explained = drops & bool(drops.any() and self.missed.any())
        return np.where(explained | (excess <= 0.0), measured, measured + excess)


@dataclass(frozen=True)
class AngleChannel(Channel):
    """The angle of an encoder at instants."""

    points: InterpolationPoints | None = None

    def model(self, simulation: Simulation) -> np.ndarray:
        return self.points.angle(simulation, ENCODER)


@dataclass(frozen=True)
class ForceChannel(Channel):
    """Acceleration from the encoder's angle at three instants (second difference), for a current or
    force as input: its residual times the inertia is an error of the force.
    """

    points: tuple[InterpolationPoints, InterpolationPoints, InterpolationPoints] | None = None
    length_s: np.ndarray | None = None

    def first_row(self) -> np.ndarray:
        return self.points[0].row - 1

    def model(self, simulation: Simulation) -> np.ndarray:
        first, middle, last = (point.angle(simulation, ENCODER) for point in self.points)
        return (last - 2.0 * middle + first) / self.length_s**2


@dataclass(frozen=True)
class ChannelInfo:
    """Description of a channel: its column and unit, whether it is made from Hall edges or compared
    by magnitude, a note for the user.
    """

    column: str
    unit: str
    edges: bool = False
    magnitude: bool = False
    note: str = ""


@dataclass(frozen=True)
class Samples:
    """Samples (m,) of a channel: the row at which each ends, its value and standard deviation in
    the channel's unit, whether it is censored (default: none is).
    """

    row: np.ndarray
    measured: np.ndarray
    sigma: np.ndarray
    censored: np.ndarray | None = None

    def mask(self) -> np.ndarray:
        """Whether each sample (m,) is censored."""
        return np.zeros(len(self.row), dtype=bool) if self.censored is None else self.censored


@dataclass(frozen=True)
class Spans:
    """Spans (m,) in s over which samples are means, in a log with rows at log_time_s (rows,)."""

    log_time_s: np.ndarray
    start_s: np.ndarray
    end_s: np.ndarray


@dataclass(frozen=True)
class ModelColumn:
    """Column of a simulation that a row channel compares, and the factor to the channel's unit."""

    key: str
    factor: float = field(default=1.0)


def span_channel(
    info: ChannelInfo, samples: Samples, spans: Spans, factor: float = 1.0
) -> SpanChannel:
    """A channel of mean speeds over spans; factor turns rad/s into the channel's unit."""
    return SpanChannel(
        **vars(info),
        row=samples.row,
        time_s=0.5 * (spans.start_s + spans.end_s),
        measured=samples.measured,
        sigma=samples.sigma,
        censored=samples.mask(),
        start=InterpolationPoints.of(spans.log_time_s, spans.start_s),
        end=InterpolationPoints.of(spans.log_time_s, spans.end_s),
        length_s=spans.end_s - spans.start_s,
        factor=factor,
    )


def row_channel(
    info: ChannelInfo, time_s: np.ndarray, values: np.ndarray, sigma: float, model: ModelColumn
) -> RowChannel:
    """A channel with one sample of standard deviation sigma per row (rows,) of a column; missing
    samples are left out.
    """
    row = np.flatnonzero(np.isfinite(values))
    return RowChannel(
        **vars(info),
        row=row,
        time_s=time_s[row],
        measured=values[row],
        sigma=np.full(len(row), sigma),
        censored=np.zeros(len(row), dtype=bool),
        key=model.key,
        factor=model.factor,
    )


def add_encoder(simulation: Simulation, errors: SensorErrors) -> None:
    """Add angle and speed as an encoder measures them to a simulation: with the eccentricity of the
    wheel; the shaft's own where the speed sensor has a gain or a lag, which an encoder has not.
    """
    differs = (errors.gain[:, 1] != 1.0) | (errors.lag_s[:, 1] > 0.0)
    for name, sensor, shaft in zip(ENCODER, SPEED_SENSOR, SHAFT, strict=True):
        simulation[name] = simulation[sensor]
        if differs.any():
            simulation[name] = np.where(differs[:, None], simulation[shaft], simulation[sensor])
