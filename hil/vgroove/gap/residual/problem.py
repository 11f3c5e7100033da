"""Turns logs and a rig into normalised residuals, batched over parameter sets: the one function
that every fit and figure is made from.

    problem = load_problem(logs, rig, restart_s=0.25, threads=2)
    problem.residuals(theta)        (B, P) -> (B, n): (measured - model) / sigma, unclipped, finite;
    theta0 holds the rig's own values
    problem.signal, log, row, time_s, block, regime, sigma, measured, conditional      (n,) what
    each residual is
    problem.folds                   (train, test) masks; every residual is in one test mask
    problem.judged                  (n,) residuals that the contract's figures are made of: a part
    of a long log, all of a short one
    problem.gap(r, mask)            RMS of r clipped at 10
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.gap.residual import agreement
from vgroove.gap.residual.angle_alignment import align_angles
from vgroove.gap.residual.batches import alike
from vgroove.gap.residual.blocks import Blocks
from vgroove.gap.residual.channels import (
    CLOCK,
    DROPS_EDGES,
    Channel,
    Simulation,
    SpanChannel,
    show_encoder,
)
from vgroove.gap.residual.measured_run import MeasuredRun, prepare_run
from vgroove.gap.residual.sensor_filters import correct_filters
from vgroove.gap.residual.speed_ripple import add_speed_ripple
from vgroove.rig import Rig

CLIP = agreement.CLIP
SENSOR_EFFECTS = (
    "current_gain.relative",
    "speed_gain.relative",
    "current_offset.offset_a",
    "current_lag.time_constant_s",
    "speed_lag.time_constant_s",
)
SIMULATED_LOADS = ("none", "torque", "pendulum")
# parameter sets that a thread takes on at once, and rows of their logs: what stays in its cache
PORTION, PORTION_ROWS = 48, 200_000
RAN_AWAY = 1e6


@dataclass(frozen=True)
class SignalInfo:
    """One judged column over all logs: unit, median sigma in that unit, whether it is made from
    edges or compared by magnitude.
    """

    column: str
    unit: str
    sigma: float
    edges: bool
    magnitude: bool
    note: str


@dataclass(frozen=True)
class Problem:
    """Logs and a rig, ready to be asked how far any parameter set is from the measurement; see the
    file's head for the arrays.
    """

    rig: Rig
    runs: tuple[MeasuredRun, ...]
    theta0: np.ndarray
    restart_s: float
    threads: int
    signals: list[SignalInfo]
    regimes: list[str]
    signal: np.ndarray
    log: np.ndarray
    row: np.ndarray
    time_s: np.ndarray
    measured: np.ndarray
    sigma: np.ndarray
    conditional: np.ndarray
    block: np.ndarray
    regime: np.ndarray
    fold: np.ndarray
    judged: np.ndarray
    warnings: list[str]

    parameters = list(_core.PARAMETERS)

    @property
    def n(self) -> int:
        """Number of residuals over all logs."""
        return len(self.signal)

    @property
    def logs(self) -> list[Any]:
        """The logs, in the order of the indices in `log`."""
        return [run.log for run in self.runs]

    @cached_property
    def folds(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Masks (train, test) of each fold."""
        return [(self.fold != k, self.fold == k) for k in np.unique(self.fold)]

    @property
    def held_out_s(self) -> list[list[list[float]]]:
        """Judged stretches [from, to] in seconds, a list per log."""
        return [run.blocks.stretches() for run in self.runs]

    def index(self, name: str) -> int:
        """Column of a parameter in theta; VgrooveError for one that the plant does not have."""
        try:
            return self.parameters.index(name)
        except ValueError as error:
            raise VgrooveError(f"the plant has no parameter {name}") from error

    @property
    def missed_edges(self) -> tuple[float, float]:
        """Edges that the speed columns seem to have missed, and all edges, seen or not."""
        channels = [
            c
            for run in self.runs
            for c in run.channels
            if isinstance(c, SpanChannel) and c.missed is not None
        ]
        missed = sum(float(c.missed[~c.conditional].sum()) for c in channels)
        return missed, missed + sum(np.count_nonzero(~c.conditional) for c in channels)

    @property
    def missed_share(self) -> float:
        """Share of the edges that the speed columns seem to have missed: what hall_dropout's
        probability would be.
        """
        missed, edges = self.missed_edges
        return missed / max(1.0, edges)

    def simulate(
        self, theta: np.ndarray, unfinished: str = "nan", threads: int = 1
    ) -> list[Simulation]:
        """Every log's simulation, restarted as judged: (B, rows) arrays as
        vgroove._core.simulate_log gives, CLOCK and DROPS_EDGES.
        """
        theta = np.ascontiguousarray(np.atleast_2d(theta), dtype=float)
        gain, offset, lag = self._sensors(theta)
        command_clock = theta[:, self.index("effects.clock_skew.command_clock")] != 0.0
        clock = 1.0 + np.where(
            command_clock, 0.0, theta[:, self.index("effects.clock_skew.relative")]
        )
        delayed, found = theta[:, self.index("effects.speed_lag.delay_form")] != 0.0, []
        limit_a = theta[:, self.index("effects.current_saturation.limit_a")]
        for run in self.runs:
            states = add_speed_ripple(
                self, run, theta, run.restarts.states(gain, offset, lag, delayed, clock, limit_a)
            )
            found.append(
                _core.simulate_log(
                    run.drive, theta, run.starts, states, threads=threads, unfinished=unfinished
                )
            )
            found[-1][CLOCK] = clock
            found[-1][DROPS_EDGES] = theta[:, self.index("effects.hall_dropout.probability")] > 0.0
            if np.any(lag > 0.0):
                correct_filters(found[-1], np.asarray(run.log.time_s), run.restarts, lag, delayed)
            show_encoder(found[-1], gain[:, 1], lag[:, 1])
        return found

    def _sensors(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gain, offset and lag (B, 2) of the current and speed sensors, through which a measured
        state is seen.
        """
        at = {name: theta[:, self.index(f"effects.{name}")] for name in SENSOR_EFFECTS}
        gain = np.stack(
            [1.0 + at["current_gain.relative"], 1.0 + at["speed_gain.relative"]], axis=1
        )
        offset = np.stack([at["current_offset.offset_a"], np.zeros(len(theta))], axis=1)
        return (
            gain,
            offset,
            np.stack([at["current_lag.time_constant_s"], at["speed_lag.time_constant_s"]], axis=1),
        )

    def models(self, theta: np.ndarray) -> np.ndarray:
        """What the measurement is compared with, the model with offsets that nobody knows: (B, n)
        in the signals' units.
        """
        parts = []
        for run, simulation in zip(self.runs, self.simulate(theta), strict=True):
            parts += [channel.compared(simulation) for channel in run.channels]
        return np.concatenate(parts, axis=1)

    def residuals(self, theta: np.ndarray) -> np.ndarray:
        """(measured - model) / sigma, (B, n) for theta (B, P) or (P,); unclipped, finite (a model
        that runs away reads 1e6).

        Portions of the batch, sets of like structure together, run side by side: the simulation and
        what is made of it.
        """
        theta = np.atleast_2d(theta)
        out, rows = np.empty((len(theta), self.n)), sum(len(log.time_s) for log in self.logs)
        size = max(1, min(PORTION, PORTION_ROWS // rows, -(-len(theta) // self.threads)))
        effects = [name.startswith("effects.") for name in self.parameters]
        parts = alike((theta != self.theta0)[:, effects], size)
        with ThreadPoolExecutor(self.threads) as pool:
            list(pool.map(lambda part: self._fill(out, part, theta[part]), parts))
        return out

    def _fill(self, out: np.ndarray, places: np.ndarray, theta: np.ndarray) -> None:
        """Write the residuals of theta to those rows of out, while what is simulated is at hand."""
        first = 0
        for run, simulation in zip(self.runs, self.simulate(theta), strict=True):
            for channel in run.channels:
                rows = slice(first, first := first + len(channel.row))
                for place, model in zip(places, channel.compared(simulation), strict=True):
                    np.subtract(channel.measured, model, out=out[place, rows])
                    np.divide(out[place, rows], channel.sigma, out=out[place, rows])
        for place in places:
            residual = out[place]
            if not np.isfinite(residual.sum()):
                residual[~np.isfinite(residual)] = RAN_AWAY

    def squared(self, residual: np.ndarray) -> np.ndarray:
        """Squares clipped at 10^2, same shape; nan where a conditional residual does not count."""
        square = np.minimum(np.square(residual), CLIP**2)
        return np.where(self.conditional & (residual == 0.0), np.nan, square)

    def gap(self, residual: np.ndarray, mask: np.ndarray | None = None) -> Any:
        """RMS over the mask (default: judged) of residuals (n,) -> float or (B, n) -> (B,), each
        clipped at 10; 0 where nothing counts.
        """
        mask = self.judged if mask is None else mask
        square = self.squared(residual)[..., mask]
        counted = np.isfinite(square)
        value = np.sqrt(
            np.where(counted, square, 0.0).sum(axis=-1) / np.maximum(counted.sum(axis=-1), 1)
        )
        return float(value) if np.ndim(value) == 0 else value

    def gap_by_signal(
        self, residual: np.ndarray, mask: np.ndarray | None = None
    ) -> dict[str, float]:
        """RMS error of each signal in its unit, each error clipped at 10 sigma; residual (n,)."""
        mask = self.judged if mask is None else mask
        square = self.squared(residual) * self.sigma**2
        chosen = [mask & (self.signal == k) & np.isfinite(square) for k in range(len(self.signals))]
        return {
            s.column: float(np.sqrt(square[m].mean())) if m.any() else 0.0
            for s, m in zip(self.signals, chosen, strict=True)
        }

    def floor_by_signal(self, mask: np.ndarray | None = None) -> dict[str, float]:
        """What noise alone gives each signal in its unit."""
        return self.gap_by_signal(np.ones(self.n), mask)

    def floor(self, mask: np.ndarray | None = None) -> float:
        """What noise alone gives the gap: 1, since sigma is the sensors' own."""
        return 1.0

    def iso18571(
        self, residual: np.ndarray, mask: np.ndarray | None = None
    ) -> dict[str, float | None]:
        """ISO/TS 18571 overall rating 0..1 of each signal over the mask; None where a signal is too
        short or flat to rate.
        """
        mask = (self.judged if mask is None else mask) & ~self.conditional
        model = self.measured - residual * self.sigma
        ratings: dict[str, float | None] = {}
        for k, signal in enumerate(self.signals):
            parts = [mask & (self.signal == k) & (self.log == j) for j in range(len(self.runs))]
            found = [
                agreement.iso18571(self.time_s[m], self.measured[m], model[m])
                for m in parts
                if m.any()
            ]
            rated = [(rating, count) for rating, count in found if rating is not None]
            ratings[signal.column] = (
                float(np.average([r for r, _ in rated], weights=[c for _, c in rated]))
                if rated
                else None
            )
        return ratings

    def traces(
        self, theta: np.ndarray
    ) -> list[dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]]:
        """For plots, per log: column -> (time_s, measured, model) in units; conditional rows are
        left out.
        """
        model = self.models(np.atleast_2d(theta)[:1])[0]
        found = []
        for j in range(len(self.runs)):
            masks = {
                s.column: (self.log == j) & (self.signal == k) & ~self.conditional
                for k, s in enumerate(self.signals)
            }
            found.append(
                {
                    c: (self.time_s[m], self.measured[m], model[m])
                    for c, m in masks.items()
                    if m.any()
                }
            )
        return found


def load_problem(
    logs: Sequence[Any], rig: Rig, restart_s: float = 0.25, threads: int = 2
) -> Problem:
    """Problem of one tool's logs (Log objects or paths) and a rig.

    VgrooveError when the rig's input column is missing, nothing else is measured, or the rig's
    mechanism or load is not simulated yet.
    """
    _check_simulated(rig)
    if not logs:
        raise VgrooveError("no log to judge")
    if restart_s <= 0.0:
        raise VgrooveError("restart_s must be above 0")
    runs = tuple(prepare_run(_read(log), rig, restart_s) for log in logs)
    problem = _join(rig, runs, restart_s, threads)
    _check_reach(problem)
    return align_angles(problem, problem.theta0)


def _check_reach(problem: Problem) -> None:
    """A rig that the plant cannot follow through its logs is refused; parameter sets of a fit only
    read as far off.
    """
    try:
        problem.simulate(problem.theta0, unfinished="raise")
    except RuntimeError as error:
        raise VgrooveError(f"the rig cannot be simulated along the log: {error}") from error


def _read(log: Any) -> Any:
    if not isinstance(log, str | Path):
        return log
    from vgroove.log import read_log

    return read_log(log)


def _check_simulated(rig: Rig) -> None:
    if rig.mechanism["kind"] != "none":
        raise VgrooveError(
            f"a log of a tool with mechanism {rig.mechanism['kind']} cannot be judged yet, only one with mechanism none"
        )
    if rig.load["kind"] not in SIMULATED_LOADS:
        raise VgrooveError(
            f"a log of a tool with load {rig.load['kind']} cannot be judged yet, only with {', '.join(SIMULATED_LOADS)}"
        )


def _join(rig: Rig, runs: tuple[MeasuredRun, ...], restart_s: float, threads: int) -> Problem:
    """Concatenate the channels of all logs; the order is log by log, channel by channel, as
    Problem.models gives it.
    """
    pairs = [(j, run, channel) for j, run in enumerate(runs) for channel in run.channels]
    columns = list(dict.fromkeys(channel.column for _, _, channel in pairs))
    regimes = list(dict.fromkeys(name for run in runs for name in run.regimes))
    signals = [
        _signal_info(column, [c for _, _, c in pairs if c.column == column]) for column in columns
    ]
    block = np.concatenate([run.blocks.of(channel.time_s) for _, run, channel in pairs])
    sizes = [len(channel.row) for _, _, channel in pairs]
    return Problem(
        rig=rig,
        runs=runs,
        theta0=rig.parameters(),
        restart_s=restart_s,
        threads=threads,
        signals=signals,
        regimes=regimes,
        signal=np.repeat([columns.index(c.column) for _, _, c in pairs], sizes),
        log=np.repeat([j for j, _, _ in pairs], sizes),
        row=np.concatenate([c.row for _, _, c in pairs]),
        time_s=np.concatenate([c.time_s for _, _, c in pairs]),
        measured=np.concatenate([c.measured for _, _, c in pairs]),
        sigma=np.concatenate([c.sigma for _, _, c in pairs]),
        conditional=np.concatenate([c.conditional for _, _, c in pairs]),
        block=block,
        regime=np.concatenate([_regime_of(run, channel, regimes) for _, run, channel in pairs]),
        fold=_per_log(pairs, block, lambda blocks, b: blocks.fold_of(b)),
        judged=_per_log(pairs, block, lambda blocks, b: blocks.judged(b)),
        warnings=[warning for run in runs for warning in run.warnings],
    )


def _regime_of(run: MeasuredRun, channel: Channel, regimes: list[str]) -> np.ndarray:
    number = np.array([regimes.index(name) for name in run.regimes])
    return number[run.regime[channel.row]]


def _per_log(
    pairs: list[tuple[int, MeasuredRun, Channel]], block: np.ndarray, ask: Any
) -> np.ndarray:
    parts, first = [], 0
    for _, run, channel in pairs:
        blocks: Blocks = run.blocks
        parts.append(ask(blocks, block[first : first + len(channel.row)]))
        first += len(channel.row)
    return np.concatenate(parts)


def _signal_info(column: str, channels: list[Channel]) -> SignalInfo:
    sigma = float(np.median(np.concatenate([c.sigma for c in channels])))
    notes = "; ".join(dict.fromkeys(c.note for c in channels if c.note))
    return SignalInfo(
        column,
        channels[0].unit,
        sigma,
        any(c.edges for c in channels),
        any(c.magnitude for c in channels),
        notes,
    )
