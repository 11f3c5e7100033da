"""A case: rig, true tool, profile and effects of a size; its run, its log, and the visibility of an
effect.
"""

from dataclasses import dataclass, replace

import numpy as np
from disturbances import (
    Disturbance,
    disturbed_command,
    disturbed_run,
    disturbed_stamps,
    disturbed_tool,
)
from effects import BY_ID, split
from profiles import Profile, command, held, sampled
from rigs import Rig, generator_params
from signals import Sensors, deviations, gap, noisy
from truth import Command, Generator, Run

LEVELS = 255.0  # of the duty
NOISELESS = {"hall_jitter_s": 0.0}
MISSING_SHARE = 0.01  # of the samples that a logger of the kind "missing" leaves empty
VISIBLE_WITHIN, VISIBLE_ATTEMPTS = 0.03, 14  # of the search for the visible limit


@dataclass(frozen=True)
class Setting:
    """Everything of a case but its effects; `tool` is `rig` off by its tolerances, `logger` the
    kind of the rows: ideal, irregular, missing, mixed, jitter or lost; `disturbances` act beside
    the effects.
    """

    rig: Rig
    tool: Rig
    profile: Profile
    seconds: float
    seed: int
    logger: str = "ideal"
    disturbances: tuple[Disturbance, ...] = ()


def row_times(setting: Setting) -> np.ndarray:
    """Ends of the rows: uniform, or irregular by up to a third of the interval."""
    step = 1.0 / setting.rig.sensors.log_hz
    grid = step * np.arange(1, round(setting.seconds / step) + 1)
    if setting.logger not in ("irregular", "mixed"):
        return grid
    rng = np.random.default_rng([setting.seed, 11])
    return np.sort(np.round(grid + step * rng.uniform(-0.33, 0.33, len(grid)), 6))


def simulate(
    setting: Setting, params: dict[str, float]
) -> tuple[Run, Command, np.ndarray, Sensors]:
    """Run the tool with the parameters of its effects: (run, command in true time, time stamps of
    the rows, sensors with the logger's settings).
    """
    tool_params, logger = split(params)
    stamps = row_times(setting)
    true_time = stamps / (1.0 + logger.get("clock_skew", 0.0))
    grid = np.concatenate([[0.0], true_time])
    made = command(setting.profile, setting.rig.slew_per_s, grid, LEVELS)
    phase = np.random.default_rng([setting.seed, 12]).uniform(0.1, 1.4)
    largest = float(np.max(setting.profile.load_nm, initial=0.0)) / setting.rig.ratio
    tool = Generator(
        **generator_params(setting.tool),
        hall_offset_rad=phase,
        load_reference_nm=max(largest, 0.005),
        seed=setting.seed + 1,
    )
    tool.set(duty_levels=0.0)
    tool.set(**tool_params)
    sensors = replace(
        setting.rig.sensors, **{k: v for k, v in logger.items() if k.startswith("speed")}
    )
    tool.set(**disturbed_tool(setting.disturbances, setting.tool.ratio))
    driven = disturbed_command(setting.disturbances, made, setting.profile, setting.seconds)
    run = tool.run(driven, true_time)
    return (
        disturbed_run(setting.disturbances, run, made, sensors),
        made,
        disturbed_stamps(setting.disturbances, stamps),
        sensors,
    )


def columns(setting: Setting, params: dict[str, float]) -> dict[str, np.ndarray]:
    """The columns of the log, a missing sample as nan, and the shaft's angle as angle_rad."""
    run, made, stamps, sensors = simulate(setting, params)
    skew = split(params)[1].get("command_skew", 0.0)
    at = run.time_s / (1.0 + skew)
    duty = np.round(sampled(made.time_s, made.duty, at) * LEVELS) / LEVELS
    rng = np.random.default_rng([setting.seed, 13])
    out = {"time_s": stamps, "duty": duty, "angle_rad": run.angle_rad, **noisy(run, sensors, rng)}
    if setting.profile.coast_at_zero:
        out["coast"] = held(made.time_s, made.coast, at)
    if setting.rig.load == "torque":
        out["load_nm"] = (
            np.interp(run.time_s, made.load_time_s, made.load_nm)
            if len(made.load_time_s)
            else np.zeros(len(stamps))
        )
    if setting.logger in ("missing", "mixed"):
        for name in ("supply_v", "current_a", "speed_rpm"):
            missing = rng.uniform(size=len(stamps)) < MISSING_SHARE
            out[name] = np.where(missing, np.nan, out[name])
    if setting.logger == "jitter":
        step = 1.0 / setting.rig.sensors.log_hz
        out["time_s"] = np.round(stamps + step * 0.05 * rng.uniform(-1.0, 1.0, len(stamps)), 6)
    return out


def effect_params(setting: Setting, effect_id: str, size: float) -> dict[str, float]:
    """Parameters of an effect of this size on the setting's tool; its other parameters are drawn by
    the setting's seed alone.
    """
    rng = np.random.default_rng([setting.seed, *effect_id.encode()])
    return BY_ID[effect_id].make(setting.tool, size, rng)


def visibility(setting: Setting, reference: Run, effect_id: str, size: float) -> float:
    """Normalised RMS difference to the effect-free run of the same seed."""
    params = effect_params(setting, effect_id, size)
    run, _, _, sensors = simulate(setting, params | NOISELESS)
    skew = params.get("command_skew", 0.0) + params.get("clock_skew", 0.0)
    model = simulate_skewed(setting, skew) if skew else reference
    return gap(deviations(run, model, sensors, setting.rig.sensors))


def simulate_skewed(setting: Setting, skew: float) -> Run:
    """The run of a model by a log with a wrong clock: the effect-free tool with the command at the
    times of the log.
    """
    grid = np.concatenate([[0.0], row_times(setting)])
    made = command(setting.profile, setting.rig.slew_per_s, grid, LEVELS)
    made = Command(
        made.time_s * (1.0 + skew), made.duty, made.coast, made.load_time_s, made.load_nm
    )
    tool = Generator(**generator_params(setting.tool), duty_levels=0.0)
    return tool.run(made, row_times(setting))


def visible_limit(setting: Setting, effect_id: str, sign: float = 1.0) -> float | None:
    """The size (unsigned) at which the visibility is 1, within 3 %; None where no size up to the
    effect's top is visible.
    """
    effect = BY_ID[effect_id]
    reference = simulate(setting, NOISELESS)[0]
    top = effect.top(setting.rig)
    size = min(effect.start_size(setting.rig), top)
    low, high = 0.0, np.inf
    for _ in range(VISIBLE_ATTEMPTS):
        found = visibility(setting, reference, effect_id, sign * size)
        if abs(found - 1.0) < VISIBLE_WITHIN:
            return size
        low, high = (size, high) if found < 1.0 else (low, size)
        if found < 1.0 and size >= top:
            return None
        step = float(np.clip(1.0 / max(found, 1e-6), 0.1, 10.0))
        size = min(size * step, top)
        if not low < size < high:
            size = 0.5 * (low + min(high, top))
    return size if low > 0.0 else None
