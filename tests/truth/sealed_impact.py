"""The sealed effect of the demo with the impact tool: of its mechanism, joint, drivetrain or
sensors; drawn by a seed, committed to by its hash, opened after the verdict.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from impact_cases import ImpactSetting, effect_params, hidden_state
from impact_effects import BY_ID, OUTSIDE_IDS, accepted, split
from impact_joints import slip_torque
from impact_rigs import impact_params, reference_rig
from impact_tool import ImpactTruthTool
from impact_visible import largest, reference_of, visible_limit
from profiles import Profile
from sealed import BOARD, TOOL_NOISE, Sealed, kind_of_seed, write_sealed

# Effects that a constant trigger on one joint shows: a run-down, a reversal or a change of the duty
# is not part of the run, and the board removes an offset of the current at rest.
IMPACT_IDS = (
    "groove_friction",
    "spring_rate",
    "spring_preload",
    "impact_damping",
    "lug_wear",
    "joint_stiffness",
    "thread_friction",
    "supply_resistance",
    "supply_droop",
    "winding_resistance",
    "winding_heating",
    "torque_constant",
    "coulomb_friction",
    "viscous_friction",
    "added_inertia",
    "load_dependent_friction",
    "current_gain",
    "current_lag",
    "speed_gain",
    "supply_gain",
)
SIZES = (2.0, 8.0)  # multiples of the visible limit
JOINT = {"run_torque_nm": 0.3, "slip_slope_nm_per_rad": 200.0}
PRESS_S, TRAVEL, SECONDS = 0.2, 0.95, 2.4


def demo_setting(seed: int) -> ImpactSetting:
    """The demo's own run: the trigger pulled and held, on the reference tool and a hard joint."""
    rig = replace(reference_rig("hard_joint", **JOINT), slew_per_s=6.0, sensors=BOARD)
    times, duty = np.array([0.0, PRESS_S]), np.array([0.0, TRAVEL])
    return ImpactSetting(rig, rig, Profile("demo", times, duty, coast_at_zero=True), SECONDS, seed)


def draw_impact_answer(seed: int) -> dict[str, object]:
    """Label, ids, accepted ids, size and tool parameters of a seed; of ten seeds in a row one has
    no effect and one is outside the catalogue.
    """
    kind = kind_of_seed(seed, 46)
    for attempt in range(20):
        rng = np.random.default_rng([seed, 39, attempt])
        setting = demo_setting(int(rng.integers(1, 2**31)))
        if kind == 0:
            return {"label": "none", "ids": [], "accept": [], "tool_seed": setting.seed} | {
                "params": {}
            }
        effect_id = str(rng.choice(OUTSIDE_IDS if kind == 1 else IMPACT_IDS))
        sign = float(rng.choice([-1.0, 1.0])) if BY_ID[effect_id].signed else 1.0
        multiple = float(np.exp(rng.uniform(*np.log(SIZES))))
        limit = visible_limit(reference_of(setting), effect_id, sign)
        if limit is not None and limit * multiple <= largest(setting, effect_id, sign):
            return _answer(setting, effect_id, sign * limit * multiple, multiple)
    raise RuntimeError(f"seed {seed}: no visible effect in 20 draws")


def _answer(
    setting: ImpactSetting, effect_id: str, size: float, multiple: float
) -> dict[str, object]:
    """The sealed answer for one effect."""
    params = {k: float(v) for k, v in effect_params(setting, effect_id, size).items()}
    outside = effect_id in OUTSIDE_IDS
    return {
        "label": "unlisted" if outside else "effect",
        "ids": [] if outside else [effect_id],
        "accept": [] if outside else [accepted(BY_ID[effect_id])],
        "what": effect_id,
        "size": size,
        "times_visible": multiple,
        "tool_seed": setting.seed,
        "params": params,
    }


def impact_tool_of(answer: dict[str, object]) -> ImpactTruthTool:
    """The lock-step tool that an answer describes, with its sensors' noise."""
    setting = demo_setting(int(answer["tool_seed"]))
    tool_params, joint, _ = split(dict(answer["params"]))
    angles, roughness = hidden_state(setting.tool, setting.seed)
    tool = ImpactTruthTool(
        slip_torque(setting.tool, joint, roughness),
        **(impact_params(setting.tool) | angles | TOOL_NOISE | {"seed": setting.seed + 1}),
    )
    tool.set(**tool_params)
    return tool


def draw_sealed_impact(seed: int, folder: Path) -> Sealed:
    """Draw the impact tool of a seed, and write the masked answer into `folder`."""
    answer = draw_impact_answer(seed)
    return write_sealed(answer, impact_tool_of(answer), folder)
