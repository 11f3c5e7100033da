"""Noiseless logs and their models in units of the sensors' noise; changes of the tolerated keys
and rival effects as linear responses.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from cases import NOISELESS, Setting, simulate
from effects import BY_ID, CATALOGUE, split, top_speed
from rigs import Rig, generator_params
from scipy.optimize import lsq_linear
from signals import RPM_PER_RAD_S, Sensors, hall_rows, lagged, speed_column
from truth import Command, Generator, Run

FAST = {"step_s": 2.5e-5}  # longer integration step
CLIP = 10.0  # of a residual, in sigma
MAX_PRIOR = 3.0  # sigma, of a tolerated key
HUBER_SIGMA = 30.0  # larger residuals have less weight in a fit
POSITION_S = 0.02  # angles are compared by their changes over this time
BLOCK_S = 0.5  # of the block bootstrap
# from one restart of the model's speed to the next: that of docs/spec/gap.md, section 5, or less,
# so that what is visible here is visible in the gap
RESTART_S = 0.25
DRAWS = 400  # of the block bootstrap
CONFIDENCE = (0.025, 0.975)


@dataclass(frozen=True)
class NoiselessLog:
    """A log without noise: the run at the logger's rows, the speed samples (row, time, edge period,
    speed, sigma), and the command that a model gets from the log.
    """

    setting: Setting
    run: Run
    command: Command
    row: np.ndarray
    at_s: np.ndarray
    span_s: np.ndarray
    speed: np.ndarray
    sigma: np.ndarray
    gain: float


def channels(rig: Rig) -> tuple[str, ...]:
    """The columns that are compared."""
    s = rig.sensors
    speed = ("speed_rpm",) if s.hall_pulses_per_rev or s.speed_noise_rpm else ()
    current = () if rig.input == "current_a" else ("current_a",)
    bus = ("supply_v",) if rig.input == "duty" and rig.bus == "modelled" else ()
    return (*current, *bus, *speed, *(("position_rad",) if s.position_lsb_rad else ()))


def noiseless_log(setting: Setting, params: dict[str, float]) -> NoiselessLog:
    """Run the tool with an effect; the log without noise."""
    run, made, stamps, sensors = simulate(setting, FAST | NOISELESS | params)
    logger = split(params)[1]
    clock = 1.0 + logger.get("clock_skew", 0.0)
    logged = replace(run, time_s=stamps, edge_s=run.edge_s * clock)
    given = replace(
        made,
        time_s=made.time_s * clock * (1.0 + logger.get("command_skew", 0.0)),
        load_time_s=made.load_time_s * clock,
    )
    if setting.rig.bus == "measured":
        bus_time_s = np.concatenate([[0.0], stamps[:-1]])
        given = replace(given, bus_time_s=bus_time_s, bus_v=logged.supply_v)
    if setting.rig.input == "current_a":
        given = current_command(given, stamps, logged.current_a)
    row, at_s, *samples = speed_samples(run, sensors, clock)
    if any(d.id == "row_batches" for d in setting.disturbances):
        at_s = at_s + (stamps - run.time_s * clock)[row]
    return NoiselessLog(setting, logged, given, row, at_s, *samples, 1.0 + sensors.speed_gain)


def current_command(command: Command, stamps: np.ndarray, current_a: np.ndarray) -> Command:
    """The measured current, held over each row, as the command."""
    time = np.repeat(np.concatenate([[0.0], stamps]), 2)[1:-1]
    amps = np.repeat(current_a, 2)
    return replace(command, time_s=time, duty=amps, coast=np.zeros(len(time)))


def speed_samples(run: Run, sensors: Sensors, clock: float) -> tuple[np.ndarray, ...]:
    """(row, time, edge period, speed, sigma) of the speed samples of a log: one for each new edge,
    or one for each row of a tachometer.
    """
    speed, lsb = speed_column(run, sensors), sensors.speed_lsb_rpm / RPM_PER_RAD_S / 12**0.5
    if not sensors.hall_pulses_per_rev:
        sigma = np.full(len(speed), np.hypot(lsb, sensors.speed_noise_rpm / RPM_PER_RAD_S))
        return np.arange(len(speed)), run.time_s * clock, np.zeros(len(speed)), speed, sigma
    _, at, period = hall_rows(run, sensors)
    fresh = ~np.isnan(at) & (np.diff(np.where(np.isnan(at), -1.0, at), prepend=-1.0) != 0)
    at, period, speed = at[fresh], period[fresh], np.abs(speed[fresh])
    return (
        np.flatnonzero(fresh),
        at * clock,
        period * clock,
        speed,
        np.hypot(lsb, speed * 2**0.5 * sensors.edge_jitter_s / period),
    )


def modelled(log: NoiselessLog, change: dict[str, float]) -> np.ndarray:
    """All compared samples (n,) in units of sigma, of the tool's model with a change of
    parameters.
    """
    setting = log.setting
    tool_change, logger = split(change)
    clock, late = 1.0 + logger.get("clock_skew", 0.0), 1.0 + logger.get("command_skew", 0.0)
    command = replace(
        log.command,
        time_s=log.command.time_s / (clock * late),
        load_time_s=log.command.load_time_s / clock,
        bus_time_s=log.command.bus_time_s / clock,
    )
    largest = float(np.max(setting.profile.load_nm, initial=0.0)) / setting.rig.ratio
    tool = Generator(
        **generator_params(setting.tool),
        load_reference_nm=max(largest, 0.005),
        seed=setting.seed + 1,
        duty_levels=0.0,
    )
    tool.set(
        **(
            FAST
            | NOISELESS
            | tool_change
            | ({"current_source_a": 1.0} if setting.rig.input == "current_a" else {})
        )
    )
    run = tool.run(command, log.run.time_s / clock)
    run = replace(run, time_s=log.run.time_s, speed_rad_s=run.speed_rad_s / clock)
    return in_sigma(log, run, tool_change, logger, clock)


def measured(log: NoiselessLog) -> np.ndarray:
    """The same samples (n,) of the log."""
    parts = []
    for name, sigma in sigmas(log).items():
        values = {
            "current_a": log.run.current_a,
            "supply_v": log.run.supply_v,
            "speed_rpm": since_restart(log, log.speed),
            "position_rad": steps_of(log, log.run.angle_rad),
        }[name]
        parts.append(values / sigma)
    return np.concatenate(parts)


def since_restart(log: NoiselessLog, speed: np.ndarray) -> np.ndarray:
    """The speed; with a current as input the change of the speed since the last restart, since the
    model's speed then integrates errors.
    """
    if log.setting.rig.input != "current_a" or len(speed) == 0:
        return speed
    window = (log.at_s / RESTART_S).astype(int)
    return speed - speed[np.searchsorted(window, window, side="left")]


def sigmas(log: NoiselessLog) -> dict[str, np.ndarray | float]:
    """Sigma of the samples of each channel."""
    s = log.setting.rig.sensors
    table = {
        "current_a": np.hypot(s.current_noise_a, s.current_lsb_a / 12**0.5),
        "supply_v": np.hypot(s.supply_noise_v, s.supply_lsb_v / 12**0.5),
        "speed_rpm": log.sigma,
        "position_rad": s.position_lsb_rad / 6**0.5,
    }
    return {name: table[name] for name in channels(log.setting.rig)}


def times(log: NoiselessLog) -> np.ndarray:
    """Time of each sample (n,)."""
    rows = log.run.time_s
    table = {
        "current_a": rows,
        "supply_v": rows,
        "speed_rpm": log.at_s,
        "position_rad": steps_of(log, rows, late=True),
    }
    return np.concatenate([table[name] for name in channels(log.setting.rig)])


def steps_of(log: NoiselessLog, values: np.ndarray, late: bool = False) -> np.ndarray:
    """Changes of a column over consecutive intervals of POSITION_S; with `late` its values at their
    ends.
    """
    stride = max(1, round(POSITION_S * log.setting.rig.sensors.log_hz))
    return values[stride::stride] if late else np.diff(values[::stride])


def in_sigma(
    log: NoiselessLog,
    run: Run,
    tool_change: dict[str, float],
    logger: dict[str, float],
    clock: float,
) -> np.ndarray:
    """All compared samples (n,) of a model's run in units of sigma."""
    parts = []
    for name, sigma in sigmas(log).items():
        angle = steps_of(log, hall_angle(run.angle_rad, tool_change))
        values = {"current_a": run.current_a, "supply_v": run.supply_v, "position_rad": angle}
        here = (
            since_restart(log, speeds(log, run, tool_change, logger, clock))
            if name == "speed_rpm"
            else values[name]
        )
        parts.append(here / sigma)
    return np.concatenate(parts)


def hall_angle(angle: np.ndarray, change: dict[str, float]) -> np.ndarray:
    """The angle (n,) of an eccentric sensor."""
    amplitude = change.get("hall_eccentricity_rad", 0.0)
    return (
        angle + amplitude * np.sin(angle + change.get("hall_eccentricity_phase_rad", 0.0))
        if amplitude
        else angle
    )


def speeds(
    log: NoiselessLog,
    run: Run,
    tool_change: dict[str, float],
    logger: dict[str, float],
    clock: float,
) -> np.ndarray:
    """The model's speed over each measured edge period, with the sensor's gain and lag."""
    time = np.concatenate([[run.begin_s], run.time_s])
    speed = np.concatenate([[0.0], run.speed_rad_s])
    if log.setting.rig.sensors.hall_pulses_per_rev:
        begin, end = (
            hall_angle(angles(run, t), tool_change) for t in (log.at_s - log.span_s, log.at_s)
        )
        out = np.abs(end - begin) / log.span_s
        sign = np.sign(np.interp(log.at_s, time, speed))
    else:
        out, sign = np.interp(log.at_s, time, speed), 1.0
    if logger.get("speed_lag_s") or logger.get("speed_delay_s"):
        out = sign * with_lag(
            log, run, sign * out, logger.get("speed_lag_s", 0.0), logger.get("speed_delay_s", 0.0)
        )
    return out * (1.0 + logger.get("speed_gain", 0.0)) * clock


def with_lag(
    log: NoiselessLog, run: Run, samples: np.ndarray, lag_s: float, delay_s: float
) -> np.ndarray:
    """Speed samples after the lag or delay of a sensor whose electronics hold each sample until the
    next one.
    """
    last = np.searchsorted(log.row, np.arange(len(run.time_s)), side="right") - 1
    held = np.where(last >= 0, samples[np.maximum(last, 0)], 0.0)
    if delay_s:
        late = np.searchsorted(run.time_s, run.time_s - delay_s + 1e-9, side="right") - 1
        held = np.where(late >= 0, held[np.maximum(late, 0)], 0.0)
    return (lagged(run, held, lag_s) if lag_s else held)[log.row]


def angles(run: Run, t: np.ndarray) -> np.ndarray:
    """Angle at times t by cubic Hermite interpolation of angle and speed."""
    time = np.concatenate([[run.begin_s], run.time_s])
    angle, speed = np.concatenate([[0.0], run.angle_rad]), np.concatenate([[0.0], run.speed_rad_s])
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(time) - 2)
    h = time[k + 1] - time[k]
    x = np.clip((t - time[k]) / h, 0.0, 1.0)
    return (
        (1 + 2 * x) * (1 - x) ** 2 * angle[k]
        + x * (1 - x) ** 2 * h * speed[k]
        + x * x * (3 - 2 * x) * angle[k + 1]
        + x * x * (x - 1) * h * speed[k + 1]
    )


def deviation(log: NoiselessLog) -> np.ndarray:
    """(log - model of the tool without the effect) / sigma."""
    return measured(log) - modelled(log, {})


def tolerance_columns(log: NoiselessLog, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(responses (n, p) to a sigma of each tolerated key, deviations (p,) of the tool in sigma)."""
    rig, tool, columns, tool_sigmas = log.setting.rig, log.setting.tool, [], []
    for key, sigma in rig.tolerance.items():
        name = key.split(".")[1]
        nominal = getattr(rig, name)
        columns.append(
            2.0 * (modelled(log, {name: getattr(tool, name) + 0.5 * sigma * nominal}) - base)
        )
        tool_sigmas.append((getattr(tool, name) / nominal - 1.0) / sigma)
    return np.array(columns).T.reshape(len(base), len(columns)), np.array(tool_sigmas)


def weights(found: np.ndarray) -> np.ndarray:
    """Weights (n,) of a linear fit against outliers (Huber 1964)."""
    return np.minimum(1.0, HUBER_SIGMA / np.maximum(np.abs(found), 1e-9))


def fit(
    found: np.ndarray,
    tolerated: np.ndarray,
    tool_sigmas: np.ndarray,
    columns: np.ndarray,
    least: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """(coefficients (q,) of `columns`, residual (n,)) of a weighted linear fit of `found` (n,).

    `tolerated` (n, p) are the responses to the tolerated keys, fitted under their normal prior
    within MAX_PRIOR; `tool_sigmas` (p,) are the tool's deviations in sigma; `least` (q,) bounds the
    coefficients.
    """
    w = weights(found)
    p, q = tolerated.shape[1], columns.shape[1]
    if p + q == 0:
        return np.zeros(0), found
    a = np.hstack([tolerated, columns])
    scale = np.maximum(np.sqrt(np.mean(a**2, axis=0)), 1e-12)
    scale[:p] = 1.0
    aw = a / scale * w[:, None]
    prior = np.zeros((p, p + q))
    prior[:, :p] = np.eye(p)
    gram = aw.T @ aw + prior.T @ prior
    right = aw.T @ (found * w) - prior.T @ tool_sigmas
    root = np.linalg.cholesky(gram + (1e-9 * np.trace(gram) / len(gram) + 1e-12) * np.eye(p + q))
    low = np.concatenate(
        [-MAX_PRIOR - tool_sigmas - 1e-6, np.where(np.isfinite(least), least * scale[p:], -np.inf)]
    )
    high = np.concatenate([MAX_PRIOR - tool_sigmas + 1e-6, np.full(q, np.inf)])
    x = lsq_linear(root.T, np.linalg.solve(root, right), (low, high)).x / scale
    return x[p:], found - a @ x


def clipped_rms(values: np.ndarray) -> float:
    """RMS of residuals clipped at CLIP."""
    return float(np.sqrt(np.mean(np.clip(values, -CLIP, CLIP) ** 2)))


NONE = np.zeros(0)


def after_retuning(log: NoiselessLog) -> float:
    """The gap without noise after a fit of the tolerated keys (nuisance parameters)."""
    base = modelled(log, {})
    found = measured(log) - base
    tolerated, tool_sigmas = tolerance_columns(log, base)
    return clipped_rms(fit(found, tolerated, tool_sigmas, np.zeros((len(found), 0)), NONE)[1])


def variants(
    effect_id: str, tool: Rig, size: float, top_rad_s: float
) -> list[list[dict[str, float]]]:
    """Variants of an effect of the catalogue, each as the parameters of the columns of a linear
    fit.
    """
    c, s = 0.0, np.pi / 2
    special = {
        "supply_droop": lambda: [
            [{"droop_volt_per_coulomb": size}, {"polarisation_ohm": size * 2, "polarisation_s": t}]
            for t in (0.4, 1.0, 2.5)
        ],
        "stribeck_friction": lambda: [
            [{"breakaway_nm": size, "stribeck_rad_s": v * top_rad_s}] for v in (0.04, 0.08, 0.15)
        ],
        "asymmetric_friction": lambda: [[{"forward_nm": size}, {"backward_nm": size}]],
        "cogging_torque": lambda: [
            [
                {
                    "cogging_nm": size,
                    "cogging_per_rev": n,
                    "cogging_second": 0.0,
                    "cogging_phase_rad": f,
                }
                for f in (c, s)
            ]
            for n in (1.0, 2.0, 4.0, 6.0)
        ],
        "gear_eccentricity": lambda: [
            [{"eccentricity_nm": size, "eccentricity_phase_rad": f} for f in (c, s)]
        ],
        "hall_eccentricity": lambda: [
            [{"hall_eccentricity_rad": size, "hall_eccentricity_phase_rad": f} for f in (c, s)]
        ],
        "cold_grease": lambda: [[{"grease_nm_s": size, "grease_s": t}] for t in (0.6, 1.5, 4.0)],
        "coupler_compliance": lambda: [
            [{"coupler_nm_per_rad": 1.0 / size, "coupler_damping_ratio": 0.1}]
        ],
        "winding_heating": lambda: [
            [{"heating_kelvin_per_joule": size, "heating_cooling_s": t}] for t in (4.0, 15.0)
        ],
        "speed_lag": lambda: [[{"speed_lag_s": size}], [{"speed_delay_s": size}]],
        "clock_skew": lambda: [[{"clock_skew": size}], [{"command_skew": size}]],
        "hall_dropout": list,
    }
    return (
        special[effect_id]()
        if effect_id in special
        else [[BY_ID[effect_id].make(tool, size, np.random.default_rng(0))]]
    )


def applicable(effect_id: str, setting: Setting) -> bool:
    """Whether the input and the columns of a log can show an effect."""
    rig, compared = setting.rig, channels(setting.rig)
    if effect_id in ("supply_resistance", "supply_droop"):
        return rig.input == "duty" and rig.bus != "measured"
    if effect_id == "supply_gain":
        return rig.input == "duty" and rig.bus != "absent"
    if effect_id in ("dead_time", "bridge_resistance"):
        return rig.input == "duty"
    if effect_id in ("winding_resistance", "winding_heating", "brush_drop", "inductance"):
        return rig.input != "current_a"
    if effect_id.startswith("current_"):
        return rig.input != "current_a" or effect_id in ("current_gain", "current_offset")
    if effect_id.startswith("speed_"):
        return "speed_rpm" in compared
    if effect_id.startswith("hall_"):
        return 0 < rig.sensors.hall_pulses_per_rev < 16
    needs = BY_ID[effect_id].needs
    return {"two_way": setting.profile.two_way, "load": rig.load == "torque"}.get(needs, True)


@dataclass(frozen=True)
class Rival:
    """One variant of an effect: its columns (n, q), and lower bounds (q,) of their coefficients.

    `again(part)` are the parameters at a multiple of the columns' size.
    """

    id: str
    columns: np.ndarray
    least: np.ndarray
    again: Callable[[float], dict[str, float]]


def rivals(log: NoiselessLog, base: np.ndarray) -> list[Rival]:
    """The linear responses of every effect of the catalogue that the log can show."""
    out = []
    setting = log.setting
    top_rad_s = top_speed(setting.tool)
    for effect in CATALOGUE:
        if not applicable(effect.id, setting):
            continue
        size = min(3.0 * effect.start_size(setting.tool), effect.top(setting.tool))
        for n, ways in enumerate(variants(effect.id, setting.tool, size, top_rad_s)):
            again = partial(scaled, setting.tool, effect.id, (size, n))
            columns = np.array([modelled(log, params) - base for params in ways]).T
            free = effect.signed or len(ways) > 1
            out.append(
                Rival(effect.id, columns, np.full(len(ways), -np.inf if free else 0.0), again)
            )
    return out


def scaled(
    tool: Rig, effect_id: str, size_and_variant: tuple[float, int], part: float
) -> dict[str, float]:
    """Parameters of a single-column variant at a multiple of its size, at most the effect's top."""
    size, number = size_and_variant
    top = BY_ID[effect_id].top(tool)
    sized = float(np.clip(size * part, -top, top))
    return variants(effect_id, tool, sized, top_speed(tool))[number][0]


def compare_fits(time_s: np.ndarray, truth: np.ndarray, rival: np.ndarray) -> int:
    """Compare the residuals (n,) of the truth and of a rival by a block bootstrap with the noise of
    the sensors: -1 where the rival is significantly worse, 1 where it is better, 0 otherwise
    (docs/spec/gap.md, section 5).
    """
    block = (time_s / BLOCK_S).astype(int)
    truth, rival = np.clip(truth, -CLIP, CLIP), np.clip(rival, -CLIP, CLIP)
    worse = np.bincount(block, rival**2 - truth**2)
    rng = np.random.default_rng(0)
    totals = worse[rng.integers(0, len(worse), (DRAWS, len(worse)))].sum(axis=1)
    totals = totals + 2.0 * float(np.sqrt(np.sum((rival - truth) ** 2))) * rng.standard_normal(
        DRAWS
    )
    low, high = np.quantile(totals, CONFIDENCE)
    return -1 if low > 0.0 else (1 if high < 0.0 else 0)
