"""Prepares one log of a hammering tool: the plant's input, the windows of its impact cycles, and
their measured statistics with standard deviations.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.gap.cleaning.missing_values import interpolate_missing
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES
from vgroove.gap.residual.blocks import FoldBlocks, cut_blocks
from vgroove.gap.residual.clean_log import CleanLog
from vgroove.gap.residual.immutable import freeze_arrays
from vgroove.gap.residual.impact.cycle_statistics import CycleReader, StatisticPart
from vgroove.gap.residual.impact.cycle_windows import CycleWindows
from vgroove.gap.residual.impact.log_cycles import read_cycles
from vgroove.gap.residual.impact.missing_rows import Fill, fills_of, incomplete_spans
from vgroove.gap.residual.impact.nuisance import NuisanceDirections, whitened
from vgroove.gap.residual.impact.run_up import RunUp, run_up_spans
from vgroove.gap.residual.impact.unusable import (
    refuse_begun_hammering,
    warn_of_sparse,
    without_failed_speed,
)
from vgroove.gap.residual.inputs import DrivingColumns, read_input

PLACES = ("first third of the run", "second third of the run", "last third of the run")
REST_SIGMAS = 5.0  # speed of the first row, in standard deviations, up to which the tool rests
NONE = np.zeros(0)


@dataclass(frozen=True)
class FirstSpans:
    """The first spans of a run-up: the plant's input along them, and of their judged statistics
    (m,): judged marks them among those of the spans; measured, sigma, nuisance: as in the run.
    """

    early: DrivingColumns
    run_up: RunUp
    judged: np.ndarray
    measured: np.ndarray
    sigma: np.ndarray
    nuisance: NuisanceDirections | None

    def __post_init__(self) -> None:
        freeze_arrays(self)

    def residuals(self, means: np.ndarray) -> np.ndarray:
        """(measured - model) / sigma (B, m) for the means (B, n) of a model in the spans, without
        what nuisances explain.
        """
        return whitened((self.measured - means[:, self.judged]) / self.sigma, self.nuisance)


@dataclass(frozen=True)
class StartSearch:
    """What the search for the hammer's start angle needs. contact_row: row, between two rows, at
    which the hammer of the rig's model first meets the anvil; until_contact: the plant's input up
    to there; stages: the spans that are compared, first those up to the first blows, last all.
    Weights of the m statistics of the first stage where angles are compared: of_trials (m,) for the
    first angles, of_halves (K, m) for each of the K halvings of the step.
    """

    contact_row: float
    until_contact: DrivingColumns
    stages: tuple[FirstSpans, ...]
    of_trials: np.ndarray
    of_halves: np.ndarray

    def __post_init__(self) -> None:
        freeze_arrays(self)


@dataclass(frozen=True)
class ImpactRun:
    """One log prepared for the comparison of statistics; immutable.

    log: cleaned; drive: the plant's input; early: its rows of the run-up alone (None: no run-up, or
    the rig states the start angle of the hammer); reader: of the cycle's statistics; run_up: spans
    before the cycle has settled; measured, sigma (n,): the log's statistics, part by part, and
    their standard deviations, infinite for those that are not judged; nuisance: how the judged ones
    respond to what a log does not determine; search: of the start angle of the hammer (None: no
    run-up); pulses: edges a turn of a Hall sensor (0: the speed is not made from edges); timeout_s:
    after which it reads 0; fills: of the columns with missing samples, which a simulation must lack
    too.
    """

    log: Any
    drive: _core.LogInput
    early: DrivingColumns | None
    reader: CycleReader
    run_up: RunUp
    measured: np.ndarray
    sigma: np.ndarray
    blocks: FoldBlocks
    pulses: int
    timeout_s: float
    warnings: tuple[str, ...]
    nuisance: NuisanceDirections | None = None
    search: StartSearch | None = None
    edge_scale: float = 1.0  # of the edge speeds against the time stamps; not estimated here
    fills: Mapping[str, Fill] = field(default_factory=dict)

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def windows(self) -> CycleWindows:
        """The windows of the log."""
        return self.reader.windows

    @property
    def parts(self) -> tuple[StatisticPart, ...]:
        """What the numbers of a window, and then of a span, are."""
        return (*self.reader.parts, *self.run_up.parts)

    def of_places(self, windows: np.ndarray, spans: np.ndarray) -> np.ndarray:
        """Values of windows (W,) and of spans (M,) as a value of each statistic (n,)."""
        cycles = np.tile(windows, len(self.reader.parts))
        return np.concatenate([cycles, np.tile(spans, len(self.run_up.parts))])

    @cached_property
    def part(self) -> np.ndarray:
        """Index (n,) of each statistic in `parts`."""
        count = [self.windows.count] * len(self.reader.parts)
        count += [len(self.run_up.first)] * len(self.run_up.parts)
        return np.repeat(np.arange(len(count)), count)

    @cached_property
    def is_run_up(self) -> np.ndarray:
        """Whether each statistic (n,) belongs to a span of the run-up."""
        return self.part >= len(self.reader.parts)

    @cached_property
    def window(self) -> np.ndarray:
        """Number (n,) of each statistic's window, or of its span."""
        return self.of_places(np.arange(self.windows.count), np.arange(len(self.run_up.first)))

    @cached_property
    def row(self) -> np.ndarray:
        """Row (n,) at the centre of each statistic's window or span."""
        return self.of_places(self.windows.centre, self.run_up.centre)

    @cached_property
    def judged(self) -> np.ndarray:
        """Whether each statistic (n,) is judged."""
        return np.isfinite(self.sigma)

    def first_spans(self, count: int) -> FirstSpans:
        """The first spans of the run-up."""
        kept, of_run_up = self.is_run_up & self.judged, self.window[self.is_run_up] < count
        mine, run_up = kept & (self.window < count), self.run_up.first_spans(count)
        return FirstSpans(
            self.early.first_rows(run_up.end_row),
            run_up,
            self.judged[self.is_run_up][of_run_up],
            self.measured[mine],
            self.sigma[mine],
            None if self.nuisance is None else self.nuisance.of_rows(mine[self.judged]),
        )

    @cached_property
    def all_spans(self) -> FirstSpans:
        """All spans of the run-up."""
        return self.first_spans(len(self.run_up.first))

    def read(self, columns: Mapping[str, np.ndarray], add_noise: bool) -> np.ndarray:
        """Statistics (B, n) of columns (B, rows); add_noise: of a simulation, whose scatter lacks
        the sensors' noise.
        """
        cycles = self.reader.statistics(self.reader.fit(columns), add_noise)
        spans = self.run_up.means(columns)
        parts = np.swapaxes(cycles, 1, 2), spans
        return np.concatenate([each.reshape(len(each), -1) for each in parts], axis=1)

    def residuals(self, statistics: np.ndarray) -> np.ndarray:
        """(measured - model) / sigma of the judged statistics (..., judged) for a model's (..., n),
        without what nuisances explain.
        """
        kept = self.judged
        found = (self.measured[kept] - statistics[..., kept]) / self.sigma[kept]
        return whitened(found, self.nuisance)


def prepare_impact_run(clean: CleanLog) -> ImpactRun:
    """The run-up and the statistics of the impact cycles of a cleaned log; VgrooveError where the
    log holds nothing that can be compared with the simulation.
    """
    drive = read_input(clean).columns
    values, reader = read_cycles(clean, drive.command)
    known = without_failed_speed(clean, reader, values)
    if known is not clean:
        clean = known
        values, reader = read_cycles(clean, drive.command)
    at_rest = begins_at_rest(values, reader.noise)
    rests = at_rest and "speed_rpm" in values
    refuse_begun_hammering(clean, reader.windows, drive.command, rests)
    for name, column in values.items():
        clean.warn_of_dead_sensor(name, column)
    warn_of_sparse(clean, values, reader.incomplete)
    pulses = clean.rig.sensors.get("hall_pulses_per_rev", 0)
    pulses = pulses if 0 < pulses < MIN_COUNTING_PULSES else 0
    run_up = run_up_spans(reader.windows, drive.command, tuple(values), pulses, at_rest)
    run = ImpactRun(
        clean.log,
        drive.plant(),
        drive.first_rows(run_up.end_row) if run_up.end_row else None,
        reader,
        run_up,
        NONE,
        NONE,
        cut_blocks(clean.time_s, np.inf),
        pulses,
        clean.rig.sensors.get("hall_timeout_s", np.inf),
        tuple(clean.warnings),
        fills=fills_of(clean.time_s, {name: clean.columns[name] for name in values}),
    )
    columns = {name: column[None] for name, column in values.items()}
    return replace(run, measured=run.read(columns, False)[0], sigma=own_sigma(run, columns))


def begins_at_rest(values: Mapping[str, np.ndarray], noise: Mapping[str, float]) -> bool:
    """Whether a log begins at rest, as far as its columns determine it."""
    if "speed_rpm" not in values:
        return True
    return bool(np.abs(values["speed_rpm"][0]) <= REST_SIGMAS * noise["speed_rpm"])


def own_sigma(run: ImpactRun, columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Standard deviations (n,) of a log's statistics from its own columns (1, rows): scatter and
    noise; infinite for windows that spans replace, and where samples are missing in the log.
    """
    reader, run_up = run.reader, run.run_up
    variance = reader.variances(reader.fit(columns))
    replaced = run.windows.first + 1 < run_up.end_row
    variance[replaced] = np.inf
    spans = run_up.sigma(run_up.means(columns)[0], reader.noise)
    spans[incomplete_in_run_up(run)] = np.inf
    return np.concatenate([np.sqrt(variance).T.ravel(), spans.ravel()])


def incomplete_in_run_up(run: ImpactRun) -> np.ndarray:
    """Whether each of M spans of the run-up cannot be judged in each of C columns (C, M): the
    column lacks samples there, or all columns did in an earlier span. Whole rows are missing then,
    and with them the command that the rest of the run-up follows.
    """
    run_up, cycle = run.run_up, run.windows.cycle_rows
    columns = [run.log.columns[name] for name in run_up.columns]
    incomplete = np.stack([incomplete_spans(run_up.first, run_up.rows, cycle, c) for c in columns])
    return incomplete | np.logical_or.accumulate(incomplete.all(axis=0))


def white_sigma(run: ImpactRun) -> np.ndarray:
    """Standard deviations (n,) that white noise of the columns causes in a log's statistics, 1 in
    those of the run-up.
    """
    columns = {n: interpolate_missing(run.log.time_s, run.log.columns[n]) for n in run.reader.noise}
    fit = run.reader.fit({name: np.asarray(c, float)[None] for name, c in columns.items()})
    cycles = np.sqrt(run.reader.noise_variances(fit)).T.ravel()
    return np.concatenate([cycles, np.ones(len(run.part) - len(cycles))])
