"""The torque balance of a log along its measured motion, as residuals that depend on a parameter
vector: a comparison beside the forward simulation, for a driving column that is noisy, or sampled
too slowly to be integrated.

Method: the inverse dynamic identification model of robotics (M. Gautier, IEEE International
Conference on Robotics and Automation, 1997). The plant is simulated over each row with an inertia
so large that the shaft keeps its measured speed ("held"); its change of speed times that inertia is
the impulse of the net torque. The mean net torque over a span of rows is compared with the true
inertia times the measured acceleration, so that noise of the driving column enters once and is not
integrated.

An error of the torque is divided by the torque of a unit of the driving column (the parameter set's
gain, N m per A, V or duty) and multiplied by that of the nominal motor: an error of the input, in
N m. The gain is found by a second simulation with the driving column shifted.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.gap.catalogue import CATALOGUE
from vgroove.gap.cleaning.missing_values import has_values, interpolate_missing
from vgroove.gap.cleaning.sensor_noise import command_noise_sigma
from vgroove.gap.residual.channels import (
    CLOCK,
    DROPS_EDGES,
    Channel,
    RowChannel,
    Simulation,
    add_encoder,
)
from vgroove.gap.residual.input_uncertainty import full_volt
from vgroove.gap.residual.inputs import DrivingColumns
from vgroove.gap.residual.measured_run import MeasuredRun
from vgroove.gap.residual.problem import Problem
from vgroove.gap.residual.restarts import Restarts
from vgroove.gap.residual.sensors import SensorErrors
from vgroove.gap.residual.shaft_inertia import shaft_inertia
from vgroove.rig import Rig
from vgroove.units import RAD_S_PER_RPM

HELD_INERTIA = 1e6  # inertia of the held shaft, in inertias of the rig's shaft
# keys of a Simulation: impulse (B, rows) in N m s of the net torque over each row, and its change
# per unit of the driving column; inertia (B,) of the shaft
NET_TORQUE, GAIN = "net_impulse_nm_s", "impulse_gain"
INERTIA = "inertia_kg_m2"
MOTOR_INERTIA = "motor.inertia_kg_m2"
ADDED_INERTIA = "effects.added_inertia.kg_m2"
# parameters, or beginnings of their names, without influence on the gain: mechanics, and the
# sensors of the motion
GAIN_UNCHANGED = (
    MOTOR_INERTIA,
    "motor.viscous_nm_s_per_rad",
    "motor.coulomb_nm",
    *(f"effects.{e.id}." for e in CATALOGUE if e.subsystem in ("motor_mechanical", "gearbox")),
    "effects.speed_gain.",
    "effects.speed_lag.",
)


@dataclass(frozen=True)
class BalanceRules:
    """Spans over which torques are averaged; chosen on the logs of tests/data/real."""

    max_span_s: float = 0.05  # longest span that is widened to reduce the noise of acceleration
    # a span is wide enough when the noise of the acceleration's torque is below this share of its
    # scatter over the log
    acceleration_share: float = 0.25
    min_rows: int = 50  # spans that a log must hold
    # shift of the driving column by which the gain is found, as a share of the 95 % quantile of
    # those of its magnitudes that are not 0
    shift_share: float = 0.25
    min_gain_share: float = 1e-4  # smallest gain, as a share of the nominal motor's
    short_row_share: float = 1e-6  # length of a short row, in the shortest interval between rows


BALANCE = BalanceRules()


@dataclass(frozen=True)
class TorqueChannel(Channel):
    """Mean torque at the motor shaft over spans of rows, N m. measured: the nominal motor's torque
    at the measured input. model: its torque at the input with which the measured motion would be in
    balance. (An error of the torque itself would vanish for a motor without torque.)
    """

    begin: np.ndarray | None = None  # (m,) row at the start of each span
    acceleration: np.ndarray | None = None  # (m,) measured, rad/s^2
    gain: np.ndarray | None = None  # (m,) of the nominal motor, N m per unit of the driving column

    def first_row(self) -> np.ndarray:
        return self.begin

    def model(self, simulation: Simulation) -> np.ndarray:
        net, gain = (self._mean(simulation, name) for name in (NET_TORQUE, GAIN))
        error = net - simulation[INERTIA][:, None] * self.acceleration
        gain = np.maximum(gain, BALANCE.min_gain_share * self.gain)
        return self.measured - error * self.gain / gain

    def _mean(self, simulation: Simulation, name: str) -> np.ndarray:
        """Mean (B, m) over the spans of a torque whose impulse over each row is known."""
        impulse, time_s = np.cumsum(simulation[name], axis=1), simulation["time_s"][0]
        return (impulse[:, self.row] - impulse[:, self.begin]) / (
            time_s[self.row] - time_s[self.begin]
        )


@dataclass(frozen=True)
class HeldMotion:
    """The measured motion of a log: mean speed (rows,) in rad/s over the interval that each row
    closes, angle (rows,) in rad and speed (rows,) at the rows, standard deviations of the latter
    and of the mean speed in rad/s, whether the interval of each row (rows,) is known, and whether
    an encoder measured it.
    """

    mean_speed: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    sigma: float
    mean_sigma: float
    known: np.ndarray
    from_angle: bool

    def speed_errors(self, errors: SensorErrors) -> tuple[np.ndarray, np.ndarray]:
        """Gain (B,) and lag (B,) in s of the measured speed for the sensor errors of B parameter
        sets. That of an encoder has the logger's clock as its gain, and no lag.
        """
        if self.from_angle:
            return 1.0 / errors.clock, np.zeros_like(errors.clock)
        return errors.gain[:, 1], errors.lag_s[:, 1]


def measured_motion(run: MeasuredRun, rig: Rig) -> HeldMotion | None:
    """The motion of a log from its encoder, or from a speed column that is not made from edges;
    None without either.
    """
    time_s, columns = np.asarray(run.log.time_s, float), run.log.columns
    step = np.diff(time_s)
    command = np.asarray(columns[rig.input["kind"]], float)
    if has_values(columns, "position_rad"):
        angle = np.asarray(columns["position_rad"], float)
        mean = np.diff(angle, prepend=np.nan) / np.concatenate([[np.nan], step])
        known = np.isfinite(mean) & np.isfinite(command)
        change = np.sqrt(2.0) * run.noise["position_rad"].sigma / float(np.median(step))
        filled = interpolate_missing(time_s, angle)
        speed = np.gradient(filled, time_s)  # central differences, over two intervals
        return HeldMotion(np.nan_to_num(mean), filled, speed, 0.5 * change, change, known, True)
    if not has_values(columns, "speed_rpm") or run.pitch_rad > 0.0:
        return None
    speed = np.asarray(columns["speed_rpm"], float) * RAD_S_PER_RPM
    mean = 0.5 * (speed + np.concatenate([[np.nan], speed[:-1]]))
    known = np.isfinite(mean) & np.isfinite(command)
    sigma = run.noise["speed_rpm"].sigma * RAD_S_PER_RPM
    turned = np.concatenate([[0.0], np.cumsum(np.nan_to_num(mean[1:]) * step)])
    filled = interpolate_missing(time_s, speed)
    of_mean = sigma / np.sqrt(2.0)
    return HeldMotion(np.nan_to_num(mean), turned, filled, sigma, of_mean, known, False)


@dataclass(frozen=True)
class HeldRun(MeasuredRun):
    """A run whose shaft follows the measured motion; held: that motion; held_drive: the plant's
    input with short rows (see _with_short_rows), shifted_drive: the same with the driving column
    shifted, shift: that shift (rows,) in its unit.
    """

    held: HeldMotion | None = None
    held_drive: _core.LogInput | None = None
    shifted_drive: _core.LogInput | None = None
    shift: np.ndarray | None = None
    nominal_gain: np.ndarray | None = None  # (rows,) GAIN of the rig; None until computed


@dataclass(frozen=True)
class BalanceProblem(Problem):
    """The torque balance of logs as a measured problem; other judged columns are compared with the
    simulation along the measured motion.
    """

    def simulate(
        self, theta: np.ndarray, unfinished: str = "nan", threads: int = 1
    ) -> list[Simulation]:
        """Simulation of every log along its measured motion, with the impulse of the net torque
        over each row, N m s, and the inertia at the shaft (B,).
        """
        theta = np.ascontiguousarray(np.atleast_2d(theta), dtype=float)
        errors = SensorErrors.of(theta, self.index)
        inertia = self._inertia(theta)
        held = theta.copy()
        held[:, self.index(MOTOR_INERTIA)] = HELD_INERTIA * self.rig.shaft_inertia_kg_m2
        held[:, self.index(ADDED_INERTIA)] = 0.0  # would add to that of the held shaft
        found = []
        for run in self.runs:
            simulation = _held_simulation(self, run, held, errors)
            simulation[CLOCK], simulation[DROPS_EDGES] = errors.clock, np.zeros(len(theta), bool)
            simulation[INERTIA] = inertia / run.held.speed_errors(errors)[0]
            add_encoder(simulation, errors)
            found.append(simulation)
        return found

    @property
    def rows_per_span(self) -> int:
        """Rows over which torques are averaged, the least of all logs."""
        return min(
            int(channel.row[0] - channel.begin[0])
            for run in self.runs
            for channel in run.channels
            if isinstance(channel, TorqueChannel)
        )

    def _inertia(self, theta: np.ndarray) -> np.ndarray:
        """Inertia (B,) at the motor shaft."""
        return shaft_inertia(lambda name: theta[:, self.index(name)], self.rig.load["kind"])


def _held_simulation(
    problem: Problem, run: HeldRun, theta: np.ndarray, errors: SensorErrors
) -> Simulation:
    """Simulation of one log for parameter sets (B, P) with a held shaft, row by row."""
    states = _held_states(run, errors)
    inertia = theta[:, problem.index(MOTOR_INERTIA)][:, None]
    out, gained = _row_by_row(run.held_drive, theta, states)
    out[NET_TORQUE] = np.where(run.held.known, gained * inertia, 0.0)
    if run.nominal_gain is not None and not changes_gain(problem, theta):
        out[GAIN] = run.nominal_gain[None, :]
    else:
        _, shifted = _row_by_row(run.shifted_drive, theta, states)
        out[GAIN] = np.where(run.held.known, (shifted - gained) * inertia / run.shift, 0.0)
    out["time_s"] = np.asarray(run.log.time_s, float)[None, :]
    return out


def changes_gain(problem: Problem, theta: np.ndarray) -> bool:
    """Whether parameter sets (B, P) differ from the rig in anything that changes the gain."""
    columns = [
        k for k, name in enumerate(problem.parameters) if not name.startswith(GAIN_UNCHANGED)
    ]
    return bool(np.any(theta[:, columns] != problem.theta0[columns]))


def _row_by_row(
    drive: _core.LogInput, theta: np.ndarray, states: np.ndarray
) -> tuple[Simulation, np.ndarray]:
    """Simulation of every row of a log with short rows in between (see _with_short_rows), from the
    state (B, rows - 1, 3) at its start, and the speed gained in it (B, rows), rad/s.
    """
    starts = 2 * np.arange(states.shape[1], dtype=np.int64) + 1
    part = _core.simulate_log(drive, theta, starts, states, threads=1, unfinished="nan")
    out = {name: np.ascontiguousarray(values[:, ::2]) for name, values in part.items()}
    gained = np.zeros_like(out["speed_rad_s"])
    gained[:, 1:] = out["speed_rad_s"][:, 1:] - states[:, :, 1]
    return out, gained


def _with_short_rows(columns: DrivingColumns) -> DrivingColumns:
    """Driving columns with a short row after each row, at whose end the plant restarts: a restart
    at a row itself would overwrite the end of the interval before it.
    """
    short_s = BALANCE.short_row_share * float(np.min(np.diff(columns.time_s)))
    time_s = np.repeat(columns.time_s, 2)[:-1]
    time_s[1::2] += short_s

    def doubled(values: Any) -> Any:
        return np.repeat(values, 2)[:-1] if isinstance(values, np.ndarray) else values

    more = {name: doubled(values) for name, values in columns.more.items()}
    return DrivingColumns(time_s, columns.kind, doubled(columns.command), more)


def _held_states(run: HeldRun, errors: SensorErrors) -> np.ndarray:
    """States (B, rows - 1, 3) at the start of each row's interval: the plant's own steady-state
    current (nan), speed, angle.
    """
    motion = run.held
    gain, lag_s = motion.speed_errors(errors)
    slope = np.gradient(motion.speed, np.asarray(run.log.time_s, float))[1:]
    speed = (motion.mean_speed[1:] + lag_s[:, None] * slope) / gain[:, None]
    states = np.empty((*speed.shape, 3))
    states[:, :, 0], states[:, :, 1], states[:, :, 2] = np.nan, speed, motion.angle[:-1]
    return states


def balance_problem(problem: Problem) -> BalanceProblem | None:
    """The torque balance of a problem's logs; None where a log shows no motion besides Hall edges,
    has too few rows, or a driving column that is 0 throughout.
    """
    from vgroove.gap.residual.loading import join_runs

    runs = [_held_run(run, problem.rig) for run in problem.runs]
    if any(run is None for run in runs):
        return None
    joined = join_runs(problem.rig, tuple(runs), problem.restart_s, problem.threads)
    problem = BalanceProblem(**vars(joined))
    nominal = problem.simulate(problem.theta0)
    runs = [
        replace(run, nominal_gain=one[GAIN][0])
        for run, one in zip(problem.runs, nominal, strict=True)
    ]
    return replace(problem, runs=tuple(runs))


def _held_run(run: MeasuredRun, rig: Rig) -> HeldRun | None:
    motion = measured_motion(run, rig)
    if motion is None or np.count_nonzero(motion.known) < BALANCE.min_rows:
        return None
    if not run.driving.command.any():
        return None
    channel = _torque_channel(run, rig, motion)
    if channel is None:
        return None
    others = [_along_motion(c, rig, motion) for c in run.channels if isinstance(c, RowChannel)]
    others = [c for c in others if c.column in ("current_a", "supply_v") and len(c.row)]
    values = vars(run) | {"channels": (channel, *others), "restarts": _first_restart(run)}
    columns, shift = _with_short_rows(run.driving), _shift(run)
    moved = _with_short_rows(replace(run.driving, command=run.driving.command + shift))
    return HeldRun(
        **values,
        held=motion,
        held_drive=columns.plant(),
        shifted_drive=moved.plant(),
        shift=shift,
    )


def _shift(run: MeasuredRun) -> np.ndarray:
    """Shift of the driving column (rows,), in its unit and away from 0, so that no row changes its
    sign.
    """
    command = run.driving.command
    size = BALANCE.shift_share * float(np.quantile(np.abs(command[command != 0.0]), 0.95))
    return np.where(command < 0.0, -size, size)


def _first_restart(run: MeasuredRun) -> Restarts:
    """The first restart of a run alone: later angles are measured, so that none is aligned."""
    kept = {
        name: value[:1] if isinstance(value, np.ndarray) and value.ndim else value
        for name, value in vars(run.restarts).items()
    }
    return Restarts(**(kept | {"smoothing": run.restarts.smoothing[:1]}))


def _along_motion(channel: RowChannel, rig: Rig, motion: HeldMotion) -> RowChannel:
    """A current or bus channel at the rows whose motion is known; the error of the speed adds to
    the standard deviation of the current.
    """
    channel = channel.select(motion.known[channel.row])
    if channel.column != "current_a":
        return channel
    amps_per_rad_s = rig.motor["torque_constant_nm_per_a"] / rig.motor["resistance_ohm"]
    return replace(channel, sigma=np.hypot(channel.sigma, amps_per_rad_s * motion.mean_sigma))


def _torque_channel(run: MeasuredRun, rig: Rig, motion: HeldMotion) -> TorqueChannel | None:
    """Torques over spans of rows. A span is doubled, up to max_span_s, until the noise of its
    acceleration is small beside the scatter of the acceleration or the noise of the input; None for
    a log with too few spans.
    """
    time_s = np.asarray(run.log.time_s, float)
    input_sigma = _input_torque_sigma(run, rig)
    rows, found = 1, None
    while True:
        begin, end = _spans(motion.known, rows)
        if len(begin) < BALANCE.min_rows:
            break
        length = time_s[end] - time_s[begin]
        acceleration = (motion.speed[end] - motion.speed[begin]) / length
        noise = rig.shaft_inertia_kg_m2 * np.sqrt(2.0) * motion.sigma / length
        sigma = np.hypot(input_sigma / np.sqrt(rows), noise)
        found = begin, end, acceleration, sigma
        scatter = BALANCE.acceleration_share * rig.shaft_inertia_kg_m2 * acceleration.std()
        enough = np.median(noise) <= max(scatter, input_sigma / np.sqrt(rows))
        if enough or 2.0 * np.median(length) > BALANCE.max_span_s:
            break
        rows *= 2
    if found is None:
        return None
    begin, end, acceleration, sigma = found
    gain = rig.motor["torque_constant_nm_per_a"]
    if rig.input["kind"] != "current_a":
        gain *= full_volt(rig, run.log.columns) / rig.motor["resistance_ohm"]
    return TorqueChannel(
        "torque_nm",
        "N m",
        end,
        time_s[end],
        _driving_torque(run, rig, motion, begin, end),
        np.maximum(sigma, np.finfo(float).tiny),
        np.zeros(len(end), dtype=bool),
        note="torque balance along the measured motion",
        begin=begin,
        acceleration=acceleration,
        gain=np.full(len(end), gain),
    )


def _spans(known: np.ndarray, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """First and last row (m,) of consecutive spans of `rows` intervals that are all known."""
    begin = np.arange(0, len(known) - rows, rows)
    unknown = np.concatenate([[0], np.cumsum(~known)])
    whole = unknown[begin + rows + 1] == unknown[begin + 1]
    return begin[whole], begin[whole] + rows


def _input_torque_sigma(run: MeasuredRun, rig: Rig) -> float:
    """Standard deviation in N m of the torque of one row from noise of the driving column."""
    kind, constant = rig.input["kind"], rig.motor["torque_constant_nm_per_a"]
    values = np.asarray(run.log.columns[kind], float)
    if kind == "current_a":
        return constant * run.noise["current_a"].sigma
    noise = command_noise_sigma(values)
    return constant / rig.motor["resistance_ohm"] * full_volt(rig, run.log.columns) * noise


def _steady_current(run: MeasuredRun, rig: Rig, back_emf: np.ndarray) -> np.ndarray:
    """Current (m,) in A of the nominal motor once the winding's transient has decayed, at the
    driving column's values (m,) and a back-EMF in V; where the current is the column, that column.
    """
    command = run.driving.command
    if rig.input["kind"] == "current_a":
        return command
    volts = full_volt(rig, run.log.columns)
    if rig.input["kind"] == "duty" and rig.bus_is_measured:
        volts = interpolate_missing(run.log.time_s, run.log.columns["supply_v"])
    return (command * volts - back_emf) / rig.motor["resistance_ohm"]


def _driving_torque(
    run: MeasuredRun, rig: Rig, motion: HeldMotion, begin: np.ndarray, end: np.ndarray
) -> np.ndarray:
    """Mean torque (m,) in N m of the nominal motor over spans of rows."""
    back_emf = rig.motor["torque_constant_nm_per_a"] * motion.mean_speed
    current = _steady_current(run, rig, back_emf)
    time_s = np.asarray(run.log.time_s, float)
    mean = _span_means(current, time_s, begin, end)
    return rig.motor["torque_constant_nm_per_a"] * mean


def _span_means(
    values: np.ndarray, time_s: np.ndarray, begin: np.ndarray, end: np.ndarray
) -> np.ndarray:
    """Means (m,) over spans of rows of values (rows,) that hold in the interval before each row."""
    total = np.cumsum(values * np.diff(time_s, prepend=time_s[0]))
    return (total[end] - total[begin]) / (time_s[end] - time_s[begin])
