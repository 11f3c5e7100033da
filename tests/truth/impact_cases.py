"""Cases of the impact tool: the rig that the diagnosis gets, the true tool, the command and the
effects with their sizes; runs of them, and the logs that they give.
"""

from dataclasses import dataclass, replace

import numpy as np
from impact_effects import BY_ID, split
from impact_forms import other_form
from impact_joints import Roughness, slip_torque
from impact_rigs import ImpactRig, impact_params
from impact_tool import ImpactGenerator, ImpactRun
from profiles import Profile, command, held, sampled
from signals import Sensors, noisy
from truth import Command

LEVELS = 255.0  # of the duty
BENCH = ("anvil_torque_nm", "anvil_angle_rad", "hammer_mm")
# Noise of the bench channels, 1 sigma
BENCH_NOISE = {"anvil_torque_nm": 0.1, "anvil_angle_rad": 2e-4, "hammer_mm": 0.01}
ROUGH_SIGMA, ROUGH_LENGTH_RAD = (0.01, 0.04), (0.1, 1.0)


@dataclass(frozen=True)
class ImpactSetting:
    """Everything of a case but its effects; `tool` is `rig` off by its tolerances. `seed` draws
    what no log reveals: start angles of hammer and sensor wheel, roughness of the joint, noise.
    With `other_forms` the effects have other functional forms than the catalogue's.
    """

    rig: ImpactRig
    tool: ImpactRig
    profile: Profile
    seconds: float
    seed: int
    other_forms: bool = False


@dataclass(frozen=True)
class Logged:
    """A run, the command in true time, the time stamps (n,) of the rows, the sensors with the
    logger's settings, and the ratio of logged to true time.
    """

    out: ImpactRun
    command: Command
    stamps: np.ndarray
    sensors: Sensors
    clock: float


def hidden_state(rig: ImpactRig, seed: int) -> tuple[dict[str, float], Roughness]:
    """Start angles of hammer and sensor wheel as parameters, and the joint's roughness."""
    rng = np.random.default_rng([seed, 12])
    gap = 2.0 * np.pi / rig["mechanism.lug_count"] - rig["mechanism.lug_overlap_rad"]
    angles = {
        "hammer_start_rad": -gap * float(rng.uniform(0.02, 0.98)),
        "hall_offset_rad": float(rng.uniform(0.1, 1.4)),
    }
    sigma = float(rng.uniform(*ROUGH_SIGMA))
    length = float(np.exp(rng.uniform(*np.log(ROUGH_LENGTH_RAD))))
    return angles, Roughness(sigma, length, seed)


def simulate(setting: ImpactSetting, params: dict[str, float]) -> Logged:
    """Run the tool with the parameters of its effects."""
    tool_params, joint, logger = split(params)
    step = 1.0 / setting.rig.sensors.log_hz
    stamps = step * np.arange(1, round(setting.seconds / step) + 1)
    clock = 1.0 + logger.get("clock_skew", 0.0)
    rows = stamps / clock
    made = command(setting.profile, setting.rig.slew_per_s, np.concatenate([[0.0], rows]), LEVELS)
    angles, roughness = hidden_state(setting.tool, setting.seed)
    tool = ImpactGenerator(**impact_params(setting.tool), **angles, seed=setting.seed + 1)
    tool.set(**tool_params)
    out = tool.run(made, slip_torque(setting.tool, joint, roughness), rows)
    speed = {key: value for key, value in logger.items() if key.startswith("speed")}
    return Logged(out, made, stamps, replace(setting.rig.sensors, **speed), clock)


def columns(setting: ImpactSetting, logged: Logged) -> dict[str, np.ndarray]:
    """The columns of the log of a run, with the noise of the sensors."""
    run, made = logged.out.run, logged.command
    rng = np.random.default_rng([setting.seed, 13])
    duty = np.round(sampled(made.time_s, made.duty, run.time_s) * LEVELS) / LEVELS
    out = {"time_s": logged.stamps, "duty": duty}
    if setting.profile.coast_at_zero:
        out["coast"] = held(made.time_s, made.coast, run.time_s)
    out |= noisy(run, logged.sensors, rng)
    for name in BENCH:
        noise = BENCH_NOISE[name] * rng.standard_normal(len(logged.stamps))
        out[name] = getattr(logged.out, name) + noise
    return out


def log_columns(setting: ImpactSetting, params: dict[str, float]) -> dict[str, np.ndarray]:
    """The columns of the log of a case: the bench channels are those of its rig."""
    table = columns(setting, simulate(setting, params))
    return {name: v for name, v in table.items() if name not in BENCH or name in setting.rig.bench}


def effect_params(setting: ImpactSetting, effect_id: str, size: float) -> dict[str, float]:
    """Parameters of an effect of this size on the setting's tool; its other parameters are drawn by
    the setting's seed alone.
    """
    rng = np.random.default_rng([setting.seed, *effect_id.encode()])
    made = BY_ID[effect_id].make(setting.tool, size, rng)
    if not setting.other_forms:
        return made
    rng = np.random.default_rng([setting.seed, 31, *effect_id.encode()])
    return other_form(effect_id, setting.tool, made, rng)


class UnsuitableDraw(Exception):
    """This draw makes no case; the next one is tried."""


@dataclass(frozen=True)
class ImpactCase:
    """A drawn case: kind, setting, and the effects' sizes, multiples of the visible limit and
    parameters.
    """

    kind: str
    setting: ImpactSetting
    sizes: dict[str, float]
    multiples: dict[str, float]
    params: dict[str, float]
