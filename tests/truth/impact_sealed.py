"""The sealed effect of the demo with the impact tool: drawn by a seed, committed to by its hash,
opened after the verdict.
"""

import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from impact import ImpactTruthTool
from impact_cases import ImpactSetting, effect_params, hidden_state
from impact_effects import BY_ID, OUTSIDE_IDS, accepted, split
from impact_joints import slip_torque
from impact_rigs import ImpactRig, impact_params, reference_rig
from impact_visible import largest, reference_of, visible_limit
from profiles import Profile
from sealed import PREFIX, TOOL_NOISE, mask
from signals import Sensors

# Effects of mechanism, joint, drivetrain and sensor; the board calibrates the current's offset
# itself.
DEMO_IMPACT_IDS = (
    "groove_friction",
    "spring_rate",
    "spring_preload",
    "lug_wear",
    "impact_damping",
    "winding_resistance",
    "supply_resistance",
    "torque_constant",
    "coulomb_friction",
    "viscous_friction",
    "added_inertia",
    "load_dependent_friction",
    "current_gain",
)
SIZES = (2.0, 8.0)  # times the visible limit
PULL_S, SECONDS = 0.25, 2.0  # the trigger is pulled, and the length of the run
ATTEMPTS = 20
BOARD = Sensors(
    current_noise_a=0.055,
    current_lsb_a=0.0125,
    supply_noise_v=0.02,
    supply_lsb_v=0.025,
    speed_lsb_rpm=0.5,
    hall_timeout_s=0.3,
)


@dataclass(frozen=True)
class SealedImpact:
    """An impact tool with a sealed effect; `commitment` is the SHA-256 of the answer in `path`."""

    tool: ImpactTruthTool
    commitment: str
    path: Path


def demo_rig() -> ImpactRig:
    """The reference tool on a hard joint, with the sensors of the board."""
    rig = reference_rig("hard_joint", slip_slope_nm_per_rad=100.0)
    return replace(rig, pwm_hz=31372.5, sensors=BOARD)


def demo_setting(seed: int) -> ImpactSetting:
    """The demo's run: full trigger."""
    rig = demo_rig()
    profile = Profile("demo", np.array([0.0, PULL_S]), np.array([0.0, 1.0]))
    return ImpactSetting(rig, rig, profile, SECONDS, seed)


def draw_answer(seed: int) -> dict[str, object]:
    """Label, ids, accepted ids, size and parameters of a seed; of ten seeds in a row one has no
    effect and one is outside the catalogue.
    """
    block, place = divmod(seed - 1, 10)
    kind = int(np.random.default_rng([block % 2**32, 27]).permutation(10)[place])
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([seed, 29, attempt])
        setting = demo_setting(int(rng.integers(1, 2**31)))
        found = {"label": "none", "ids": [], "accept": [], "tool_seed": setting.seed, "params": {}}
        if kind == 0:
            return found
        effect_id = str(rng.choice(OUTSIDE_IDS if kind == 1 else DEMO_IMPACT_IDS))
        sign = float(rng.choice([-1.0, 1.0])) if BY_ID[effect_id].signed else 1.0
        multiple = float(np.exp(rng.uniform(*np.log(SIZES))))
        limit = visible_limit(reference_of(setting), effect_id, sign)
        if limit is None or limit * multiple > largest(setting, effect_id, sign):
            continue
        size = sign * limit * multiple
        params = effect_params(setting, effect_id, size)
        more = {"size": size, "times_visible": multiple, "params": params}
        if kind == 1:
            return found | more | {"label": "unlisted", "what": effect_id}
        accept = [accepted(BY_ID[effect_id])]
        return found | more | {"label": "effect", "ids": [effect_id], "accept": accept}
    raise RuntimeError(f"seed {seed}: no visible effect in {ATTEMPTS} draws")


def tool_of(answer: dict[str, object]) -> ImpactTruthTool:
    """The lock-step tool that an answer describes, with its sensors' noise."""
    seed, rig = int(answer["tool_seed"]), demo_rig()
    params, joint, _ = split(dict(answer["params"]))
    angles, roughness = hidden_state(rig, seed)
    made = impact_params(rig) | angles | TOOL_NOISE | {"seed": seed + 1.0} | params
    return ImpactTruthTool(slip_torque(rig, joint, roughness), **made)


def draw_sealed_impact(seed: int, folder: Path) -> SealedImpact:
    """Draw the tool of a seed, and write the masked answer into `folder`; sealed.open_sealed opens
    it.
    """
    answer = draw_answer(seed)
    text = json.dumps(answer, sort_keys=True).encode()
    text += b" " * (1024 - len(text) % 1024)  # so that the length does not reveal the answer
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "sealed_truth.bin"
    commitment = hashlib.sha256(text).hexdigest()
    path.write_bytes(PREFIX + mask(text, commitment))
    return SealedImpact(tool_of(answer), commitment, path)
